"""Loads a page of `ferrostep compare` in Chromium: both prints, and the table above them. Arguments: the browser, the page.

Prints one line of JSON: errors of the console, requests, the table, what each print shows, and how wide the page is on a phone.
"""

import json
import os
import sys

from pages import LOOK, launched, opened, picture
from playwright.sync_api import sync_playwright


def main():
    browser_path, file = sys.argv[1], sys.argv[2]
    seen = {"errors": [], "requests": [], "sides": []}
    with sync_playwright() as playwright:
        browser = launched(playwright, browser_path)
        page = opened(browser, file, seen, viewport={"width": 1280, "height": 900})
        rows = page.locator("tbody tr")
        seen["table"] = [rows.nth(number).locator("th, td").all_inner_texts() for number in range(rows.count())]
        sides = page.frames[1:]
        for side in sides:
            side.wait_for_selector("html[data-ready]", state="attached")
            look = side.evaluate(LOOK, picture(side))
            end = side.evaluate("() => { const { c, n } = ferrostep.print; return c.time[n - 1]; }")
            seen["sides"].append({"picture": look, "end": end})

        # What is done in one print leaves the other alone.
        ours, other = sides
        ours.locator("#finding-list li button").last.click()
        seen["times"] = [side.evaluate("() => ferrostep.state.time") for side in (ours, other)]
        other.click("#play")
        other.wait_for_function("(before) => ferrostep.state.time !== before", arg=seen["times"][1])
        if "FERROSTEP_PICTURES" in os.environ:
            page.screenshot(path=os.path.join(os.environ["FERROSTEP_PICTURES"], "compare.png"))

        phone = opened(browser, file, seen, viewport={"width": 360, "height": 740}, color_scheme="dark")
        for side in phone.frames[1:]:
            side.wait_for_selector("html[data-ready]", state="attached")
        seen["phone_overflow"] = phone.evaluate("() => document.documentElement.scrollWidth - document.documentElement.clientWidth")
        if "FERROSTEP_PICTURES" in os.environ:
            phone.screenshot(path=os.path.join(os.environ["FERROSTEP_PICTURES"], "compare-phone.png"), full_page=True)
        browser.close()
    print(json.dumps(seen))


main()
