"""Loads a page of `ferrostep show` in Chromium and uses it as a person would. Arguments: the browser, the page, places as JSON.

Prints one line of JSON: errors of the console, requests, the values at the places, what the pictures look like, and where
play, findings and pointer lead.
"""

import json
import sys

from pages import LOOK, drawn, launched, opened, picture
from playwright.sync_api import sync_playwright


def controls(page):
    """Uses each control of the legend, the G-code window and the sliders, and reads what it changes."""
    time = "() => ferrostep.state.time"
    line = "() => ferrostep.print.c.line[ferrostep.stateAt(ferrostep.state.time).i]"
    found = {}
    wanted = page.evaluate("() => ferrostep.print.c.line[ferrostep.print.n >> 1]")
    page.focus("#space")
    page.keyboard.press("g")
    page.keyboard.type(str(wanted))
    page.keyboard.press("Enter")
    drawn(page)
    found["goto"] = [wanted, page.evaluate(line)]
    found["followed"] = int(page.locator("#source .current").get_attribute("data-line"))
    page.locator(f'#source [data-line="{wanted + 3}"]').click()
    drawn(page)
    found["clicked"] = [wanted + 3, page.evaluate(line)]
    before = page.evaluate(time)
    page.focus("#move")
    page.keyboard.press("ArrowLeft")
    drawn(page)
    layer = "() => ferrostep.print.c.layer[ferrostep.stateAt(ferrostep.state.time).i]"
    found["moves"] = [page.evaluate(time) < before, page.locator("#move-text").inner_text(), page.evaluate(layer)]
    page.evaluate("() => ferrostep.setTime(Infinity)")
    whole = picture(page)
    page.select_option("#mode", "feature")
    switches = page.locator("#feature-list input")
    found["features"] = switches.count()
    coloured = picture(page)
    for number in range(switches.count()):
        switches.nth(number).uncheck()
    found["hidden"] = [coloured != whole, picture(page) != coloured]
    for number in range(switches.count()):
        switches.nth(number).check()
    page.focus("#space")
    for key in "srpx":
        page.keyboard.press(key)
    found["marks"] = page.evaluate("() => ferrostep.state.places.size")
    found["marked"] = page.locator("#place-list input").count()
    for key in "srpx":
        page.keyboard.press(key)
    found["unmarked"] = page.evaluate("() => ferrostep.state.places.size === 0")
    page.keyboard.press("f")
    found["folded"] = page.evaluate("() => [legend.open, layers.open]")
    page.keyboard.press("f")
    page.select_option("#mode", "speed")
    return found


def main():
    browser_path, file, places = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
    seen = {"errors": [], "requests": [], "drawn": {}, "jumps": []}
    with sync_playwright() as playwright:
        browser = launched(playwright, browser_path)
        for mark in ("#flat", ""):
            page = opened(browser, file, seen, mark, viewport={"width": 1280, "height": 800})
            page.wait_for_selector("html[data-ready]", state="attached")
            way = page.evaluate("() => ferrostep.draws")
            page.focus("#space")
            before = picture(page)
            look = page.evaluate(LOOK, before)
            for _ in range(4):
                page.keyboard.press("ArrowLeft")
            look["coarse"] = page.evaluate("() => ferrostep.drawn.quick > 0")
            look["turned"] = picture(page) != before
            for _ in range(4):
                page.keyboard.press("ArrowRight")
            look["turned_back"] = page.evaluate(LOOK, picture(page))["share"]
            seen["drawn"][way] = look
            if mark:
                page.close()

        # The end of the line's last part, and from there back to the place.
        seen["places"] = page.evaluate(
            """(places) => places.map(({ line, to_end_s, window_s }) => {
              const { print, stateAt } = ferrostep;
              const { c, n } = print;
              let end = 0;
              for (let i = 1; i < n; i++) if (c.line[i] === line && (c.kind[i] < 2 || c.kind[i] === 4)) end = i;
              const middle = c.time[end] - to_end_s;
              const state = stateAt(middle);
              // The mean of what colours the path over the window.
              const speeds = [-0.75, -0.25, 0.25, 0.75].map((part) => stateAt(middle + part * window_s).speed);
              return { line: c.line[state.i], speed: speeds.reduce((a, b) => a + b) / 4, position: state.position };
            })""",
            places,
        )

        page.evaluate("() => ferrostep.setTime(200)")
        page.click("#play")
        started = page.evaluate("() => ferrostep.state.time")
        page.wait_for_function("(started) => ferrostep.state.time > started + 1", arg=started)
        page.click("#play")
        seen["played"] = [started, page.evaluate("() => ferrostep.state.time")]

        findings = page.evaluate("() => ferrostep.print.job.findings")
        for number, finding in enumerate(findings):
            button = page.locator("#finding-list li:not(.good)").nth(number).locator("button")
            if "line" not in finding or button.count() == 0:
                continue
            button.click()
            drawn(page)
            place = page.evaluate("() => ({ time: ferrostep.state.time, line: ferrostep.print.c.line[ferrostep.stateAt(ferrostep.state.time).i] })")
            text = page.locator("#now").inner_text()
            assert str(place["line"]) in text, text
            # Of a finding without a time: when its line ends.
            wanted = finding.get("time_s", place["time"])
            seen["jumps"].append({"wanted": finding["line"], "wanted_time": wanted, **place})

        options = page.locator("#mode option")
        seen["modes"] = options.count()
        for number in range(options.count()):
            page.select_option("#mode", index=number)
            drawn(page)

        seen["controls"] = controls(page)

        # All of the print again; the pointer on a part of it, by its own projection.
        page.evaluate("() => ferrostep.setTime(Infinity)")
        page.click('[data-view="top"]')
        drawn(page)
        box = page.locator("#space").bounding_box()
        spot = page.evaluate(
            """() => {
              const canvas = document.getElementById('space');
              for (let k = 0; k < 400; k++) {
                const [x, y] = [canvas.clientWidth * (0.3 + 0.4 * (k % 20) / 20), canvas.clientHeight * (0.3 + 0.4 * Math.floor(k / 20) / 20)];
                if (ferrostep.pick(x, y)) return [x, y];
              }
              return [0, 0];
            }"""
        )
        page.mouse.move(box["x"] + spot[0], box["y"] + spot[1])
        page.wait_for_selector("#tip:not([hidden])")
        seen["tip"] = page.locator("#tip").inner_text()

        # As a phone, in the dark: nothing is wider than the window.
        phone = opened(browser, file, seen, viewport={"width": 360, "height": 740}, color_scheme="dark")
        phone.wait_for_selector("html[data-ready]", state="attached")
        seen["phone_overflow"] = phone.evaluate(
            "() => ['html', '#figures', 'aside'].map((part) => document.querySelector(part))"
            ".map((part) => part.scrollWidth - part.clientWidth)"
        )
        browser.close()
    print(json.dumps(seen))


main()
