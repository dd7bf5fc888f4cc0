"""Uses the page that reads a print in a browser as a person would. Arguments: the browser, the page, a folder with `job.gcode`,
`printer.cfg`, `broken.cfg`, `rubbish.gcode`, `cut.gcode.gz` and `large.gcode`.

Prints one line of JSON: what the page showed for each, errors of the console, and requests. The page that it made goes into
the folder as `shown.html`.
"""

import base64
import json
import sys
from pathlib import Path

from pages import launched, opened
from playwright.sync_api import sync_playwright

DROP = """async ([name, base64]) => {
  const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  const held = new DataTransfer();
  held.items.add(new File([bytes], name));
  for (const kind of ['dragenter', 'drop']) {
    document.querySelector('#drop').dispatchEvent(new DragEvent(kind, { bubbles: true, cancelable: true, dataTransfer: held }));
  }
}"""


# What the page may ask for: itself, and what it makes.
LOCAL = ("file:", "data:", "blob:")


def outcome(page):
    """Waits for the end of the work: the print, or words about why there is none."""
    page.wait_for_function("() => ferrostep.state === 'after' || ferrostep.error")
    if page.evaluate("() => ferrostep.error"):
        return {"error": page.locator("#error").inner_text()}
    page.frame_locator("#page").locator("html[data-ready]").wait_for(state="attached")
    return {
        "time": page.locator("#time").inner_text(),
        "title": page.frame_locator("#page").locator("#title").inner_text(),
        "done": page.evaluate("() => ferrostep.done"),
        "kept": page.locator("#kept").text_content(),
        "overflows": page.evaluate("() => document.documentElement.scrollWidth > innerWidth"),
    }


def read(page, name):
    """Chooses a file and waits for the end; the page is then as before."""
    page.set_input_files("#job", name)
    seen = outcome(page)
    if "error" not in seen:
        seen["stopped"] = page.locator("#error").inner_text() if page.locator("#error").is_visible() else None
        page.click("#again")
    return seen


def main():
    browser_path, file, folder = sys.argv[1], sys.argv[2], Path(sys.argv[3])
    seen = {"errors": [], "requests": []}
    with sync_playwright() as playwright:
        browser = launched(playwright, browser_path)
        page = opened(browser, file, seen, local=LOCAL, viewport={"width": 390, "height": 844}, accept_downloads=True)
        page.set_input_files("#job", folder / "job.gcode")
        seen["chosen"] = outcome(page)
        with page.expect_download() as download:
            page.locator("#download").click()
        seen["name"] = download.value.suggested_filename
        download.value.save_as(folder / "shown.html")
        page.click("#again")

        page.set_input_files("#job", folder / "large.gcode")
        page.wait_for_function("() => document.querySelector('#progress').value > 0")
        page.keyboard.press("Escape")
        seen["cancelled"] = [page.evaluate("() => ferrostep.state"), page.locator("#drop").is_visible()]

        page.select_option("#rules", "klipper")
        page.set_input_files("#configuration", folder / "printer.cfg")
        page.evaluate(DROP, ["job.gcode", base64.b64encode((folder / "job.gcode").read_bytes()).decode()])
        seen["dropped"] = outcome(page)
        page.click("#again")
        page.set_input_files("#configuration", folder / "broken.cfg")
        seen["broken"] = read(page, folder / "job.gcode")
        page.set_input_files("#configuration", [])
        seen["rubbish"] = read(page, folder / "rubbish.gcode")
        seen["cut"] = read(page, folder / "cut.gcode.gz")
        browser.close()
    print(json.dumps(seen))


if __name__ == "__main__":
    main()
