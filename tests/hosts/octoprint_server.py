"""OctoPrint without a window, and its REST interface, for the scripts beside this one."""

import pathlib
import socket
import subprocess
import sys
import time
import uuid

import requests
import yaml

PATIENCE_S = 240
# Ports to try: another program may take one before OctoPrint does.
PORTS = 5
# So often a person tries to connect.
TRIES = 5
# Of this OctoPrint only: one of another test, which has got the port, does not know it.
KEY = uuid.uuid4().hex.upper()


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


# A line, or its answer, that was lost is asked for a second after this, s. OctoPrint's own 30 s
# would be half an hour for the lost lines of a print; and after a second the served printer's time
# continues, for which it has 2 s of motion at hand.
REPORTS_EVERY_S = 1


def settings(ports, plugins):
    return {
        "accessControl": {"salt": "salt"},
        "api": {"key": KEY, "allowCrossOrigin": False},
        "plugins": {"_disabled": ["tracking", "announcements", "pluginmanager", "softwareupdate", "pi_support", "discovery", "backup"], **plugins},
        "serial": {
            "additionalPorts": ports,
            "log": True,
            # It would halt again the printer that says it is halted.
            "sendM112OnError": False,
            "timeout": {"communication": REPORTS_EVERY_S, "communicationBusy": REPORTS_EVERY_S, "temperatureAutoreport": REPORTS_EVERY_S},
        },
        "server": {
            "firstRun": False,
            "onlineCheck": {"enabled": False},
            "pluginBlacklist": {"enabled": False},
            "seenWizards": {"backup": None, "corewizard": 4, "tracking": None},
        },
    }


class OctoPrint:
    """A running OctoPrint, with these settings of its plug-ins by their names."""

    def __init__(self, ports, folder, plugins=None):
        self.folder = pathlib.Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        (self.folder / "config.yaml").write_text(yaml.safe_dump(settings(ports, plugins or {})), encoding="utf-8")
        self.output = open(self.folder / "output.txt", "wb")
        for _ in range(PORTS):
            if self.starts(free_port()):
                return
        raise SystemExit(f"OctoPrint does not start; its log: {self.log()[-40:]}")

    def starts(self, port):
        """Whether it starts at this port; it ends where another program has taken that."""
        self.http = port
        program = pathlib.Path(sys.executable).parent / "octoprint"
        command = [program, "serve", "--iknowwhatimdoing", "--basedir", str(self.folder), "--host", "127.0.0.1", "--port", str(self.http)]
        self.process = subprocess.Popen(command, stdout=self.output, stderr=subprocess.STDOUT)
        self.wait(lambda: self.process.poll() is not None or self.is_up(), "OctoPrint does not start")
        return self.process.poll() is None

    def end(self):
        self.process.terminate()
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def is_up(self):
        try:
            return self.ask("get", "version").ok
        except requests.ConnectionError:
            return False

    def ask(self, method, path, **arguments):
        url = f"http://127.0.0.1:{self.http}/api/{path}"
        return getattr(requests, method)(url, headers={"X-Api-Key": KEY}, timeout=60, **arguments)

    def call(self, method, path, **arguments):
        reply = self.ask(method, path, **arguments)
        if reply.status_code == 503:
            return None
        if not reply.ok:
            raise SystemExit(f"{method} {path}: {reply.status_code} {reply.text}; the end of its log: {self.log()[-40:]}")
        return reply.json() if reply.content else {}

    def is_there_within(self, seconds, is_there):
        end = time.monotonic() + seconds
        while not is_there():
            if time.monotonic() > end or self.process.poll() is not None:
                return False
            time.sleep(0.02)
        return True

    def wait(self, is_there, otherwise):
        if not self.is_there_within(PATIENCE_S, is_there):
            self.give_up(otherwise)

    def give_up(self, why):
        raise SystemExit(f"{why}; its state: {self.state()}; the end of its log: {self.log()[-40:]}")

    def state(self):
        try:
            return (self.call("get", "connection") or {}).get("current", {}).get("state", "")
        except requests.ConnectionError:
            return ""

    def until(self, *states):
        self.wait(lambda: self.state() in states, f"it does not become {states}")

    def log(self):
        path = self.folder / "logs" / "serial.log"
        return path.read_text(encoding="utf-8", errors="replace").splitlines() if path.exists() else []

    def heard(self, text):
        return [line for line in self.log() if "Recv: " in line and text in line]

    def connect(self, port):
        self.call("post", "connection", json={"command": "connect", "port": port, "baudrate": 115200})
        self.until("Operational")

    def restart(self, port):
        """Connects to a halted printer and ends the halt; its temperatures after that. The printer may still be answering what it was
        sent before, and say once more that it is halted: then OctoPrint ends the connection, and a person tries again."""
        for _ in range(TRIES):
            before = len(self.heard("ok T:"))
            self.call("post", "connection", json={"command": "connect", "port": port, "baudrate": 115200})
            self.wait(lambda: not self.state().startswith(("Opening", "Detecting", "Connecting")), "it does not connect")
            if self.state() != "Operational":
                continue
            # 409: the connection has ended meanwhile.
            if self.ask("post", "printer/command", json={"commands": ["M999", "M105"]}).status_code == 409:
                continue
            self.wait(lambda: len(self.heard("ok T:")) > before or self.state() != "Operational", "no answer to M999")
            if len(self.heard("ok T:")) > before and self.state() == "Operational":
                return self.heard("ok T:")[-1].split("Recv: ", 1)[1]
        raise SystemExit(f"it does not come back; the end of its log: {self.log()[-40:]}")

    def print(self, file):
        with open(file, "rb") as gcode:
            self.call("post", "files/local", files={"file": gcode}, data={"select": "true", "print": "true"})

    def job(self, **command):
        self.call("post", "job", json=command)

    def completion(self):
        return ((self.call("get", "job") or {}).get("progress") or {}).get("completion") or 0

    def say(self, *commands, answer, again_after_s=PATIENCE_S):
        before = len(self.heard(answer))
        for _ in range(0, PATIENCE_S, again_after_s):
            self.call("post", "printer/command", json={"commands": list(commands)})
            if self.is_there_within(again_after_s, lambda: len(self.heard(answer)) > before):
                return self.heard(answer)[-1].split("Recv: ", 1)[1]
        self.give_up(f"no answer to {commands}")

    def refusals(self):
        """Refused lines: without those of a halted printer, and without remarks."""
        lines = self.heard("echo:line ")
        return [line for line in lines if "is halted" not in line and "(said once a job)" not in line]

    def figures(self):
        return self.say("M400", "M797", answer="order_digest")

    def until_printed(self):
        self.wait(lambda: self.state() == "Operational" and self.completion() >= 100, "the print does not end")
