"""Runs OctoPrint without a window, and does to its prints what a person does by its buttons (its REST interface).

    octoprint_host.py PORT FILE BAD_PORT PART FOLDER

FOLDER holds its settings and its log. PART is printed at BAD_PORT, whose line is damaged. What was seen is printed as one JSON object.
"""

import json
import sys
import time

from octoprint_server import OctoPrint

# Outside a print OctoPrint numbers no line, so what a bad line takes from a command is never sent
# again, and it is asked once more.
ASKS_AGAIN_AFTER_S = 10


def main():
    port, file, bad_port, part, folder = sys.argv[1:6]
    octoprint = OctoPrint([port, bad_port], folder)
    seen = {}
    try:
        octoprint.connect(port)
        began = time.monotonic()
        octoprint.print(file)
        octoprint.until_printed()
        seen["print_s"] = time.monotonic() - began
        seen["printed"] = octoprint.figures()

        # A pause in the middle, and on.
        octoprint.print(file)
        octoprint.wait(lambda: octoprint.completion() > 30, "the print does not go on")
        octoprint.job(command="pause", action="pause")
        octoprint.until("Paused")
        octoprint.job(command="pause", action="resume")
        octoprint.until_printed()
        seen["paused"] = octoprint.figures()

        octoprint.print(file)
        octoprint.wait(lambda: octoprint.completion() > 30, "the print does not go on")
        octoprint.job(command="cancel")
        octoprint.until("Operational")
        seen["cancelled"] = octoprint.say("M105", answer="ok T:")

        octoprint.print(file)
        octoprint.wait(lambda: octoprint.completion() > 30, "the print does not go on")
        octoprint.call("post", "printer/command", json={"command": "M112"})
        octoprint.wait(lambda: octoprint.state().startswith(("Offline", "Error", "Closed")), "it does not notice the halt")
        seen["stopped"] = octoprint.state()
        seen["restarted"] = octoprint.restart(port)
        seen["resends"] = len(octoprint.heard("Resend:"))
        seen["errors"] = [line for line in octoprint.heard("Error:") if "halted" not in line]
        seen["refusals"] = octoprint.refusals()[:5]

        # Another printer, on a bad line.
        octoprint.call("post", "connection", json={"command": "disconnect"})
        octoprint.until("Closed", "Offline")
        octoprint.connect(bad_port)
        began = time.monotonic()
        octoprint.print(part)
        octoprint.until_printed()
        # PART ends with M400.
        seen["bad_line_printed"] = octoprint.say("M797", answer="order_digest", again_after_s=ASKS_AGAIN_AFTER_S)
        seen["bad_line_s"] = time.monotonic() - began
        seen["bad_line_resends"] = len(octoprint.heard("Resend:")) - seen["resends"]
    finally:
        octoprint.end()
    print(json.dumps(seen))


main()
