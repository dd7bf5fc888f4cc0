"""Prints a file with printcore, the host behind Pronterface, and does to the print what a person does.

    printcore_host.py PORT FILE ACTION [LINE]

The person acts when so many lines of the file are sent, 1500 by default. What was seen is printed as one JSON object.
"""

import json
import os
import sys
import threading
import time

from printrun import gcoder
from printrun.printcore import printcore

PATIENCE_S = 120
# What of a line has no effect; the line is no refusal.
REMARK = "(said once a job)"
# Lines of the file after which the person acts: in a whole cube homed, hot, in the first layers.
ACTS_AT = int(sys.argv[4]) if len(sys.argv) > 4 else 1500
# The host asks after this long without a word from the printer while an answer is due, s. printcore
# waits for ever; Pronterface, which polls temperatures, continues after a time. A host that asks
# too soon gets one answer too many: from then on it has two lines under way, and printcore's
# resending fails.
ASKS_AFTER_S = 0.5
# Text by which the printer tells the host how far it is.
MARK = "as far as here"
# Outside a print printcore numbers no line, so what a bad line takes from a command is never sent
# again, and the host asks once more.
ASKS_AGAIN_AFTER_S = 5
# What printcore does without a word from the printer (its own counters) is looked at this often, s.
LOOKS_EVERY_S = 0.01


class Host:
    """printcore, and what it has heard."""

    def __init__(self, port):
        self.core = printcore()
        self.heard = []
        self.errors = []
        # Notified with every line.
        self.news = threading.Condition()
        self.core.recvcb = self.hear
        self.core.errorcb = self.errors.append
        self.port = port
        self.asked = 0
        self.watching = False
        self.asks_again_after_s = PATIENCE_S

    def hear(self, line):
        with self.news:
            self.heard.append(line.strip())
            self.news.notify_all()

    def is_there_within(self, seconds, is_there):
        end = time.monotonic() + seconds
        with self.news:
            while not is_there():
                if time.monotonic() > end:
                    return False
                self.news.wait(LOOKS_EVERY_S)
        return True

    def wait(self, is_there, otherwise):
        """Waits for something that the printer says, or that printcore makes of it right after."""
        if not self.is_there_within(PATIENCE_S, is_there):
            give_up(otherwise)

    def connect(self):
        self.core.connect(self.port, 115200)
        self.wait(lambda: self.core.online, "the printer does not answer")

    def ask_when_lost(self):
        """Asks for temperatures whenever an answer does not come."""
        self.watching = True

        def watch():
            while self.watching:
                with self.news:
                    is_silent = not self.news.wait(ASKS_AFTER_S)
                if is_silent and self.core.printing and not self.core.clear:
                    self.asked += 1
                    self.core.printer.write(b"M105\n")

        threading.Thread(target=watch, daemon=True).start()

    def start(self, file):
        """Prints a file, and M400 after it: the answer to what follows says that the printer stands."""
        with open(file, encoding="utf-8") as text:
            gcode = gcoder.LightGCode([line.strip() for line in text] + ["M400"])
        self.core.startprint(gcode)

    def until_line(self, number):
        self.wait(lambda: self.core.queueindex >= number, "the print does not go on")

    def until_printed(self):
        self.wait(lambda: not self.core.printing, "the print does not end")

    def say(self, command, answer="ok"):
        """Sends a command outside a print; what is heard up to its answer, a line that begins so."""
        before = len(self.heard)

        def answered():
            return any(line.startswith(answer) for line in self.heard[before:])

        for _ in range(0, PATIENCE_S, self.asks_again_after_s):
            self.core.send_now(command)
            if self.is_there_within(self.asks_again_after_s, answered):
                return self.heard[before:]
        give_up(f"no answer to {command}")

    def catch_up(self):
        """Waits for the answer to the line that was under way when the print ended: the next one is the next command's."""
        self.core.send_now(f"M118 {MARK}")

        def caught_up():
            after = self.heard[self.heard.index(MARK) :] if MARK in self.heard else []
            return any(line.startswith("ok") for line in after)

        self.wait(caught_up, "no answer to M118")

    def figures(self):
        """The printer's digests and counters."""
        answer = "echo:motion "
        return next(line for line in self.say("M797", answer) if line.startswith(answer))

    def count(self, start):
        return sum(line.startswith(start) for line in self.heard)


def give_up(why):
    """Ends at once: printcore's threads would go on."""
    print(why, file=sys.stderr, flush=True)
    os._exit(1)


def prints(host, file):
    host.start(file)
    host.until_printed()


def prints_over_a_bad_line(host, file):
    host.ask_when_lost()
    prints(host, file)
    host.watching = False
    host.asks_again_after_s = ASKS_AGAIN_AFTER_S


def pauses_and_resumes(host, file):
    host.start(file)
    host.until_line(ACTS_AT)
    host.core.pause()
    host.catch_up()
    # Its answer says that the printer stands.
    host.say("M400")
    host.core.resume()
    host.until_printed()


def cancels(host, file):
    host.start(file)
    host.until_line(ACTS_AT)
    host.core.cancelprint()
    host.catch_up()
    host.say("M104 S0")
    host.say("M140 S0")
    host.say("M84")
    host.say("M400")


def stops(host, file):
    """The emergency stop of Pronterface, a new connection, and a restart."""
    host.start(file)
    host.until_line(ACTS_AT)
    host.core.pause()
    host.core.send_now("M112")
    host.wait(lambda: host.count("Error:Printer halted"), "no word of the halt")
    host.core.disconnect()
    host.connect()
    host.say("M999")


def reconnects(host, file):
    """The cable is pulled in mid-print; the printer is found again, and prints the file from its start."""
    host.start(file)
    host.until_line(ACTS_AT)
    host.core.disconnect()
    host.connect()
    host.say("G92 E0")
    prints(host, file)


ACTIONS = {
    "prints": prints,
    "prints-over-a-bad-line": prints_over_a_bad_line,
    "pauses-and-resumes": pauses_and_resumes,
    "cancels": cancels,
    "stops": stops,
    "reconnects": reconnects,
}


def main():
    port, file, action = sys.argv[1:4]
    host = Host(port)
    host.connect()
    began = time.monotonic()
    ACTIONS[action](host, file)
    took_s = time.monotonic() - began
    end = host.say("M114", "X:") + host.say("M105", "ok T:")
    figures = host.figures()
    host.core.disconnect()
    print(
        json.dumps(
            {
                "took_s": took_s,
                "errors": host.errors,
                "resends": host.count("Resend:"),
                "refusals": [line for line in host.heard if line.startswith("echo:line ") and REMARK not in line][:5],
                "asked": host.asked,
                "figures": figures,
                "end": [line for line in end if line.startswith(("X:", "ok T:"))],
            }
        )
    )


main()
