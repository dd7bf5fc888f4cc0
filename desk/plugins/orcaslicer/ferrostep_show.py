# /// script
# requires-python = ">=3.10"
# dependencies = []
#
# [tool.orcaslicer.plugin]
# name = "Ferrostep"
# description = "Shows the exported G-code as a printer executes it."
# author = "The Ferrostep authors"
# version = "0.3.0"
# ///
"""Shows OrcaSlicer's exported G-code as ``ferrostep show`` draws it, in a tab of the slicer.

The file that OrcaSlicer exports is never changed, and an export never fails for this plug-in.
"""

import json
import shutil
import subprocess
import tempfile
from pathlib import Path

import orca

# A file of 100 MB takes about a minute on a small computer.
PATIENCE_S = 600

FRAME = """<!doctype html>
<meta charset="utf-8">
<style>html, body, iframe { margin: 0; width: 100%; height: 100%; border: 0 } p { font: 1rem sans-serif; padding: 1rem }</style>
<p id="words">Export G-code: its page appears here.</p>
<iframe id="page" title="The print as it is executed" hidden></iframe>
<script>
let shown = 0;
orca.onMessage(({ number, words, page }) => {
  shown = number;
  document.getElementById('words').textContent = words;
  document.getElementById('words').hidden = Boolean(page);
  const frame = document.getElementById('page');
  frame.hidden = !page;
  if (frame.src) URL.revokeObjectURL(frame.src);
  if (page) frame.src = URL.createObjectURL(new Blob([page], { type: 'text/html' }));
});
const ask = () => orca.postMessage({ shown });
ask();
setInterval(ask, 2000);
</script>
"""


class Shown:
    """The newest export: the slicer's thread writes it, the tab asks for it."""

    number, words, page = 0, "", ""

    @classmethod
    def take(cls, words, page=""):
        cls.words, cls.page = words, page
        cls.number += 1


class Refused(Exception):
    """There is no page of the file; the text says why."""


def show(file, settings):
    """The page of a G-code file, and the line about it: time, moves, findings."""
    command = settings.get("command") or "ferrostep"
    arguments = [shutil.which(command) or command, "show", str(file), "--no-open"]
    for option in ("profile", "rules"):
        if settings.get(option):
            arguments += [f"--{option}", settings[option]]
    # The folder of the file is one that OrcaSlicer lets a plug-in write to.
    with tempfile.TemporaryDirectory(dir=Path(file).parent) as folder:
        page = Path(folder) / "page.html"
        try:
            done = subprocess.run(
                [*arguments, "-o", str(page)], stdin=subprocess.DEVNULL, capture_output=True, encoding="utf-8", errors="replace", timeout=PATIENCE_S
            )
        except (OSError, ValueError) as error:
            raise Refused(f"{arguments[0]}: {error}; set the command's path in the plug-in's Config") from error
        except subprocess.TimeoutExpired as error:
            raise Refused(f"no answer within {PATIENCE_S} s") from error
        if not page.is_file():
            raise Refused(done.stderr.strip().removeprefix("error: ") or f"ferrostep ended with status {done.returncode}")
        line = done.stdout.strip().partition("page.html: ")[2]
        stop = done.stderr.strip().splitlines()[-1].removeprefix("error: ") if done.returncode else ""
        return page.read_text(encoding="utf-8"), "; ".join(filter(None, [line, stop]))


class Export(orca.slicing.SlicingPipelineCapabilityBase):
    """Reads the G-code once it is whole."""

    def get_name(self):
        return "Ferrostep page"

    def get_default_config(self):
        return {"command": "ferrostep", "profile": "", "rules": ""}

    def execute(self, ctx):
        if ctx.step != orca.slicing.Step.psGCodePostProcess:
            return orca.ExecutionResult.success()
        try:
            page, line = show(ctx.gcode_path, json.loads(self.get_config() or "{}"))
        except (Refused, OSError, ValueError) as reason:
            Shown.take(f"ferrostep: {reason}")
            return orca.ExecutionResult.skipped(Shown.words)
        Shown.take(f"ferrostep: {line}", page)
        return orca.ExecutionResult.success(Shown.words)


class Tab(orca.pages.PagesPluginCapabilityBase):
    """The tab with the page."""

    def get_name(self):
        return "Ferrostep"

    def get_ui(self):
        return FRAME

    def on_message(self, data):
        if data.get("shown") != Shown.number:
            self.post_message({"number": Shown.number, "words": Shown.words, "page": Shown.page})


@orca.plugin
class Ferrostep(orca.base):
    def register_capabilities(self):
        orca.register_capability(Export)
        orca.register_capability(Tab)
