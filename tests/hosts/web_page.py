"""Opens the page of `ferrostep serve --web` in Chromium and uses it as a person would. Arguments: the browser, the page's address.

Prints one line of JSON: errors of the console, requests to other servers, and what the page shows.
"""

import json
import os
import sys

from playwright.sync_api import sync_playwright


def main():
    browser_path, url = sys.argv[1], sys.argv[2]
    home = url.split("#")[0]
    seen = {"errors": [], "foreign": []}
    with sync_playwright() as playwright:
        # Root has no sandbox.
        browser = playwright.chromium.launch(executable_path=browser_path, args=["--no-sandbox"] if os.geteuid() == 0 else [])

        def opened(address, **how):
            page = browser.new_page(**how)
            page.set_default_timeout(60_000)
            page.on("pageerror", lambda error: seen["errors"].append(str(error)))
            page.on("request", lambda asked: None if asked.url.startswith((home, "data:")) else seen["foreign"].append(asked.url))
            page.on("dialog", lambda dialog: dialog.accept())
            page.goto(address)
            return page

        page = opened(url, viewport={"width": 1280, "height": 800})
        # The browser itself notes each answer that is a refusal.
        expected = "Failed to load resource"
        page.on(
            "console",
            lambda said: seen["errors"].append(said.text)
            if said.type in ("error", "warning") and not said.text.startswith(expected)
            else None,
        )
        page.wait_for_selector("#activity:text-is('Ready')")

        page.fill("#line", "M115")
        page.keyboard.press("Enter")
        page.wait_for_selector("#console .printer:has-text('Cap:EMERGENCY_PARSER')")
        seen["m115"] = page.locator("#console").inner_text()
        page.fill("#line", ";")
        page.keyboard.press("Enter")
        page.wait_for_selector("#message:not([hidden])")
        seen["refused"] = page.locator("#message").inner_text()

        # By hand: home, move, and filament in a cold nozzle.
        page.click("#hand button:text-is('Home')")
        page.wait_for_selector("#x:text-is('0.00')")
        page.select_option("#step", "50")
        page.click("#hand button:text-is('X+')")
        page.wait_for_selector("#x:text-is('50.00')")
        page.click("#hand button:text-is('Push')")
        page.wait_for_selector("#message:has-text('heat it first')")
        seen["cold"] = page.locator("#message").inner_text()
        page.click("#preheat")
        page.wait_for_selector("#nozzle:has-text('/ 215')")
        if "FERROSTEP_PICTURES" in os.environ:
            page.screenshot(path=os.path.join(os.environ["FERROSTEP_PICTURES"], "hand.png"), full_page=True)
        page.click("#hand [data-control*='\"nozzle_celsius\":0']")
        page.wait_for_selector("#activity:text-is('Ready')")

        job = b"G28\nM140 S50\n" + b"G1 X10 F6000\nG1 X90\n" * 100_000
        page.set_input_files("#upload", {"name": "<b>long.gcode", "mimeType": "text/plain", "buffer": job})
        page.wait_for_selector("#file:has-text('<b>long.gcode (')")
        page.click("#start:enabled")
        page.wait_for_selector("#activity:text-is('Printing')")
        page.click("#pause")
        page.wait_for_selector("#activity:text-is('Paused')")
        seen["bed"] = page.locator("#bed").inner_text()
        if "FERROSTEP_PICTURES" in os.environ:
            page.screenshot(path=os.path.join(os.environ["FERROSTEP_PICTURES"], "web.png"))
        page.click("#hand button:text-is('Home')")
        page.wait_for_selector("#message:has-text('a file is being printed')")
        page.click("#resume")
        page.wait_for_selector("#activity:text-is('Printing')")
        page.click("#cancel")
        page.wait_for_selector("#message:has-text('cancelled after line')")
        seen["message"] = page.locator("#message").inner_text()

        # As a phone, in the dark: nothing is wider than the window.
        phone = opened(url, viewport={"width": 360, "height": 740}, color_scheme="dark")
        phone.wait_for_selector("#activity:text-is('Ready')")
        seen["phone_overflow"] = phone.evaluate("() => document.documentElement.scrollWidth - document.documentElement.clientWidth")
        if "FERROSTEP_PICTURES" in os.environ:
            phone.screenshot(path=os.path.join(os.environ["FERROSTEP_PICTURES"], "phone.png"), full_page=True)

        bare = opened(home)
        bare.wait_for_selector("#message:not([hidden])")
        seen["without_token"] = bare.locator("#message").inner_text()
        browser.close()
    print(json.dumps(seen))


main()
