"""Runs OctoPrint with the plug-in of `desk/plugins/octoprint/`, and uploads files that it analyses.

    octoprint_estimates.py COMMAND PROFILE FOLDER FILE...

FOLDER gets the plug-in and OctoPrint's settings. Prints one JSON object: OctoPrint's version, its analysis of each file, and what the
plug-in wrote to `octoprint.log`.
"""

import json
import os
import pathlib
import subprocess
import sys

from octoprint_server import OctoPrint

PLUGIN = pathlib.Path(__file__).resolve().parents[2] / "desk/plugins/octoprint"


def install(folder):
    """Installs the plug-in as a person does, but beside OctoPrint's environment, which other tests share."""
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, "--target", str(folder), str(PLUGIN)], check=True)
    os.environ["PYTHONPATH"] = str(folder)


def analysis(octoprint, file):
    with open(file, "rb") as gcode:
        uploaded = octoprint.call("post", "files/local", files={"file": gcode})
    name = uploaded["files"]["local"]["name"]
    seen = {}

    def is_analysed():
        seen.update(octoprint.call("get", f"files/local/{name}") or {})
        return "estimatedPrintTime" in seen.get("gcodeAnalysis", {})

    octoprint.wait(is_analysed, f"{name} is not analysed")
    return seen["gcodeAnalysis"]


def main():
    command, profile, folder, *files = sys.argv[1:]
    folder = pathlib.Path(folder)
    install(folder / "installed")
    plugins = {"ferrostep": {"command": command, "profile": profile}}
    octoprint = OctoPrint([], folder / "octoprint", plugins)
    try:
        seen = {"version": octoprint.call("get", "version")["server"]}
        seen["analyses"] = [analysis(octoprint, file) for file in files]
    finally:
        octoprint.end()
    log = (folder / "octoprint/logs/octoprint.log").read_text(encoding="utf-8", errors="replace")
    seen["log"] = [line for line in log.splitlines() if "octoprint.plugins.ferrostep" in line]
    print(json.dumps(seen))


main()
