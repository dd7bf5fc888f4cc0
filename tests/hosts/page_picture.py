"""Takes a picture of a page of `ferrostep show`, in the middle of its print. Arguments: the browser, the page, the picture to write,
and pictures to compare it with.

Prints one line of JSON: errors, and of each picture, the new one first, its size, how much of it the print takes, and the mean
colours of its parts.
"""

import base64
import json
import sys

from pages import LOOK, launched, opened, picture
from playwright.sync_api import sync_playwright

# The part of the print's time that is shown.
SHOWN = 0.62

# Size, and the mean colours of 20 x 16 parts.
PARTS = """async (picture) => {
  const image = new Image();
  image.src = 'data:image/png;base64,' + picture;
  await image.decode();
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [20, 16];
  const context = canvas.getContext('2d');
  context.imageSmoothingQuality = 'high';
  context.drawImage(image, 0, 0, 20, 16);
  const data = [...context.getImageData(0, 0, 20, 16).data];
  return { size: [image.width, image.height], parts: data.filter((_, index) => index % 4 < 3) };
}"""


def main():
    browser_path, file, out, *others = sys.argv[1:]
    seen = {"errors": [], "requests": [], "pictures": []}
    with sync_playwright() as playwright:
        browser = launched(playwright, browser_path)
        page = opened(browser, file, seen, viewport={"width": 1000, "height": 640}, color_scheme="light")
        page.wait_for_selector("html[data-ready]", state="attached")
        page.evaluate("(share) => { const { c, n } = ferrostep.print; ferrostep.setTime(share * c.time[n - 1]); }", SHOWN)
        page.focus("#space")
        for _ in range(2):
            page.keyboard.press("+")
        # The commit is another one each time.
        page.evaluate(
            "() => { const words = document.createTreeWalker(document.querySelector('header'), NodeFilter.SHOW_TEXT);"
            " while (words.nextNode()) words.currentNode.data = words.currentNode.data.replace(/ [(]commit [^)]*[)]/, ''); }"
        )
        page.evaluate("() => document.activeElement.blur()")
        picture(page)
        page.screenshot(path=out)
        for path in [out, *others]:
            with open(path, "rb") as kept:
                text = base64.b64encode(kept.read()).decode()
            seen["pictures"].append({**page.evaluate(PARTS, text), **page.evaluate(LOOK, text)})
        browser.close()
    print(json.dumps(seen))


main()
