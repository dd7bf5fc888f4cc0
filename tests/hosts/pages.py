"""What tests of the pages share: a browser, its complaints, and what a picture of a print looks like."""

import base64
import os

# The start of a function in the page that reads a picture: its size and its bytes, four a pixel.
READ_PICTURE = """async (picture) => {
  const image = new Image();
  image.src = 'data:image/png;base64,' + picture;
  await image.decode();
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [image.width, image.height];
  const context = canvas.getContext('2d');
  context.drawImage(image, 0, 0);
  const { data } = context.getImageData(0, 0, image.width, image.height);
"""

# What a picture looks like: the share of saturated pixels, the middle of their box, and how
# many hues there are.
LOOK = READ_PICTURE + """  let count = 0;
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


def launched(playwright, browser_path):
    """The browser. Root has no sandbox; without a graphics card WebGL is computed."""
    arguments = ["--enable-unsafe-swiftshader"]
    if os.geteuid() == 0:
        arguments.append("--no-sandbox")
    return playwright.chromium.launch(executable_path=browser_path, args=arguments)


def opened(browser, file, seen, mark="", local=("file:", "data:"), **how):
    """A page of a file, whose complaints and requests go into what is seen, but for requests of these kinds."""
    page = browser.new_page(**how)
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
        lambda asked: None if asked.url.startswith(local) else seen["requests"].append(asked.url),
    )
    page.goto(f"file://{file}{mark}")
    return page


def drawn(page):
    """Waits for a frame that shows what has been done."""
    page.wait_for_function(DRAWN, arg=page.evaluate("() => ferrostep.drawn.frames"))


def picture(page):
    """The view, once all of it is drawn: a slow machine draws some of it in each frame."""
    drawn(page)
    page.wait_for_function("() => ferrostep.drawn.isWhole && ferrostep.isUpToDate()")
    return base64.b64encode(page.locator("#view").screenshot()).decode()
