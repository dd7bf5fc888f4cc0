"""Loads a page of a job that stops in Chromium, and looks at the rest of it. Arguments: the browser, the page.

Prints one line of JSON: errors of the console, requests, and what is seen with and without the rest.
"""

import json
import sys

from pages import READ_PICTURE, drawn, launched, opened, picture
from playwright.sync_api import sync_playwright

# The share of grey pixels of the view, neither as dark as its text nor as light as its ground.
GREY = READ_PICTURE + """  let count = 0;
  for (let i = 0; i < data.length; i += 4) {
    const [most, least] = [Math.max(data[i], data[i + 1], data[i + 2]), Math.min(data[i], data[i + 1], data[i + 2])];
    if (most - least < 14 && most > 60 && most < 200) count += 1;
  }
  return count / (data.length / 4);
}"""

FACTS = """() => ({
  end: ferrostep.print.c.time.at(-1), time: ferrostep.state.time, n: ferrostep.print.n, rest: ferrostep.print.rest.count,
  shown: ferrostep.state.isRestShown, checked: document.getElementById('rest').checked, legend: document.getElementById('rest-switch').innerText.trim(),
  hidden: document.getElementById('rest-switch').hidden, shares: document.getElementById('share-list').innerText, figures: document.getElementById('figures').innerText,
  finding: document.querySelector('#finding-list li').innerText, layers: ferrostep.print.layers, executed: ferrostep.print.executedLayers,
  about: document.getElementById('about-text').textContent, features: document.getElementById('feature-list').textContent,
})"""


def main():
    browser_path, file = sys.argv[1:3]
    seen = {"errors": [], "requests": [], "drawn": {}}
    with sync_playwright() as playwright:
        browser = launched(playwright, browser_path)
        for mark in ("#flat", ""):
            page = opened(browser, file, seen, mark, viewport={"width": 1280, "height": 800})
            page.wait_for_selector("html[data-ready]", state="attached")
            facts = page.evaluate(FACTS)
            page.focus("#space")
            with_rest = page.evaluate(GREY, picture(page))
            page.keyboard.press("n")
            drawn(page)
            switched = page.evaluate(FACTS)
            without = page.evaluate(GREY, picture(page))
            page.locator("#rest").check()
            drawn(page)
            again = page.evaluate(GREY, picture(page))
            # The highest layer alone is of the rest.
            page.keyboard.press("l")
            drawn(page)
            page.evaluate("() => { const slider = document.getElementById('layer-high'); slider.value = slider.max; "
                          "slider.dispatchEvent(new Event('input')); }")
            drawn(page)
            layer = page.evaluate(GREY, picture(page))
            page.evaluate("() => ferrostep.touched()")
            drawn(page)
            tip = ""
            for step in range(0, 900, 6):
                page.mouse.move(100 + step, 330)
                text = page.locator("#tip").inner_text() if page.locator("#tip").is_visible() else ""
                if "not executed" in text:
                    tip = text
                    break
            seen["drawn"][page.evaluate("() => ferrostep.draws")] = {
                "facts": facts,
                "switched": [switched["shown"], switched["checked"]],
                "grey": [with_rest, without, again, layer],
                "tip": tip,
            }
            page.close()
        browser.close()
    print(json.dumps(seen))


main()
