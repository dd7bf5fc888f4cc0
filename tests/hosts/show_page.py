"""Loads a page of `ferrostep show` in Chromium and uses it as a person would. Arguments: the browser, the page, places as JSON.

Prints one line of JSON: errors of the console, requests, the values at the places, what the pictures look like, and where
play, findings and pointer lead.
"""

import base64
import json
import os
import sys

from playwright.sync_api import sync_playwright

# What a picture looks like: the share of saturated pixels, the middle of their box, and how many hues there are.
LOOK = """async (picture) => {
  const image = new Image();
  image.src = 'data:image/png;base64,' + picture;
  await image.decode();
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [image.width, image.height];
  const context = canvas.getContext('2d');
  context.drawImage(image, 0, 0);
  const { data } = context.getImageData(0, 0, image.width, image.height);
  let count = 0;
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  const hues = new Set();
  for (let i = 0; i < data.length; i += 4) {
    const [r, g, b] = [data[i], data[i + 1], data[i + 2]];
    const most = Math.max(r, g, b);
    const range = most - Math.min(r, g, b);
    if (most < 40 || range < 0.35 * most) continue;
    const [x, y] = [i / 4 % image.width, Math.floor(i / 4 / image.width)];
    // The panels on the picture have colours, too.
    if (x < 245 && y < 300 || x > image.width - 120) continue;
    count += 1;
    box[0] = Math.min(box[0], x); box[1] = Math.min(box[1], y); box[2] = Math.max(box[2], x); box[3] = Math.max(box[3], y);
    const hue = most === r ? (g - b) / range : most === g ? 2 + (b - r) / range : 4 + (r - g) / range;
    hues.add(Math.floor(((hue + 6) % 6) * 4));
  }
  return { share: count / (data.length / 4), colours: hues.size,
    middle: [(box[0] + box[2]) / 2 / image.width, (box[1] + box[3]) / 2 / image.height] };
}"""

# A frame after this number has been drawn, or all is drawn.
DRAWN = "(frames) => ferrostep.drawn.frames > frames || ferrostep.isUpToDate()"

# The browser's word about its own reading of pictures where no graphics card shows them.
READING = "GPU stall due to ReadPixels"


def drawn(page):
    """Waits for a frame that shows what has been done."""
    page.wait_for_function(DRAWN, arg=page.evaluate("() => ferrostep.drawn.frames"))


def picture(page):
    """The view, once all of it is drawn: a slow machine draws some of it in each frame."""
    drawn(page)
    page.wait_for_function("() => ferrostep.drawn.isWhole && ferrostep.isUpToDate()")
    return base64.b64encode(page.locator("#view").screenshot()).decode()


def main():
    browser_path, file, places = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
    seen = {"errors": [], "requests": [], "drawn": {}, "jumps": []}
    # Root has no sandbox; without a graphics card WebGL is computed.
    arguments = ["--enable-unsafe-swiftshader"]
    if os.geteuid() == 0:
        arguments.append("--no-sandbox")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=browser_path, args=arguments)

        def opened(mark=""):
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            page.set_default_timeout(120_000)
            page.on(
                "console",
                lambda said: seen["errors"].append(said.text)
                if said.type in ("error", "warning") and READING not in said.text
                else None,
            )
            page.on("pageerror", lambda error: seen["errors"].append(str(error)))
            page.on(
                "request",
                lambda asked: None if asked.url.startswith(("file:", "data:")) else seen["requests"].append(asked.url),
            )
            page.goto(f"file://{file}{mark}")
            page.wait_for_selector("html[data-ready]", state="attached")
            return page

        for mark in ("#flat", ""):
            page = opened(mark)
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
        browser.close()
    print(json.dumps(seen))


main()
