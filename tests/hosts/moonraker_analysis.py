"""Lets Moonraker's own analysis component run desk/plugins/moonraker/klipper_estimator.py, and its own reader of metadata read the result.

    moonraker_analysis.py FERROSTEP PRINTER_CFG FILE FOLDER

FERROSTEP is the command, PRINTER_CFG the configuration that an imitation of Moonraker's answers tells, FILE G-code, FOLDER empty. The
component, its commands in the shell, and the reader of metadata are Moonraker's; the server around them has only what they ask for. What
was seen is printed as one JSON object.
"""

import asyncio
import configparser
import http.server
import json
import os
import pathlib
import platform
import shutil
import subprocess
import sys
import threading

from moonraker.components import analysis, shell_command
from moonraker.eventloop import EventLoop
from moonraker.utils import ServerError

KEY = "0123456789abcdef"
SCRIPT = pathlib.Path(__file__).resolve().parents[2] / "desk/plugins/moonraker/klipper_estimator.py"


def configfile(printer_cfg):
    """Klipper's object of a configuration, as Moonraker tells it."""
    parser = configparser.RawConfigParser(strict=False, inline_comment_prefixes=("#", ";"), delimiters=(":", "="))
    parser.read(printer_cfg)
    # Klipper has read what a file includes.
    return {name: dict(parser[name]) for name in parser.sections() if not name.startswith("include ")}


class Klipper(http.server.BaseHTTPRequestHandler):
    """Answers as Moonraker does in front of a running Klipper, to those who know the key."""

    answer = b""

    def do_GET(self):
        allowed = self.headers.get("X-Api-Key") == KEY and self.path == "/printer/objects/query?configfile"
        self.send_response(200 if allowed else 401)
        self.end_headers()
        self.wfile.write(self.answer if allowed else b'{"error": {"code": 401, "message": "Unauthorized"}}')

    def log_message(self, *_):
        pass


class Parts:
    """The server's other components, as far as the component asks for them."""

    route_prefix = "/"

    def __init__(self, server):
        self.server = server
        self.processors = {}

    def get_full_path(self, root, name):
        return self.server.folder / root / name

    def get_metadata_storage(self):
        return self

    def register_gcode_processor(self, name, config):
        self.processors[name] = config

    def add_reserved_path(self, *_):
        pass

    def is_ready(self):
        return True

    def get_api_key(self):
        return KEY


class Server:
    """The server around the component."""

    error = ServerError

    def __init__(self, folder, port):
        self.folder = folder
        self.port = port
        self.loop = EventLoop()
        self.parts = Parts(self)
        self.warnings = []
        self.shell = shell_command.load_component(Config(self, {}))

    def get_app_args(self):
        return {"data_path": str(self.folder)}

    def get_event_loop(self):
        return self.loop

    def get_host_info(self):
        return {"address": "127.0.0.1", "port": self.port, "hostname": "printer"}

    def lookup_component(self, name, default=None):
        return {"shell_command": self.shell}.get(name, self.parts)

    def register_endpoint(self, *_):
        pass

    def register_event_handler(self, *_):
        pass

    def add_warning(self, text, *_):
        self.warnings.append(text)


class Config:
    """The section [analysis] of moonraker.conf."""

    error = ServerError

    def __init__(self, server, options):
        self.server = server
        self.options = options

    def get_server(self):
        return self.server

    def get(self, key, default=None):
        return self.options.get(key, default)

    getint = get
    getboolean = get

    def getchoice(self, key, choices, default_key=None):
        return self.options.get(key, default_key)


async def is_refused(coroutine):
    """True if Moonraker reports an error."""
    try:
        await coroutine
    except ServerError:
        return True
    return False


def errors(*command):
    """The exit status of a command, and what it says on standard error."""
    done = subprocess.run(command, capture_output=True, check=False, text=True)
    return [done.returncode, done.stderr]


def metadata(folder, name, processors):
    """A file's metadata, as Moonraker reads them after an upload."""
    request = folder / "request.json"
    request.write_text(json.dumps({"gcode_dir": str(folder / "gcodes"), "filename": name, "processors": processors}))
    reader = pathlib.Path(analysis.__file__).parent / "file_manager/metadata.py"
    command = [sys.executable, str(reader), "-c", str(request)]
    done = subprocess.run(command, capture_output=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"metadata.py fails: {done.stderr.decode()}")
    return json.loads(done.stdout)["metadata"]


async def see(printer_cfg, source, folder):
    for name in ["gcodes", "config", "tools/klipper_estimator"]:
        (folder / name).mkdir(parents=True)
    names = ["asked.gcode", "uploaded.gcode"]
    files = [folder / "gcodes" / name for name in names]
    for file in files:
        shutil.copyfile(source, file)
    kind = "linux" if platform.machine() == "x86_64" else "rpi"
    tool = folder / f"tools/klipper_estimator/klipper_estimator_{kind}"
    tool.symlink_to(SCRIPT)

    printer = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Klipper)
    threading.Thread(target=printer.serve_forever, daemon=True).start()
    good = json.dumps({"result": {"eventtime": 1.0, "status": {"configfile": {"config": configfile(printer_cfg)}}}}).encode()
    seen = {}
    server = Server(folder, printer.server_address[1])
    component = analysis.load_component(Config(server, {"enable_auto_analysis": True, "platform": kind}))
    await component.component_init()
    seen["ready"] = component.estimator_ready
    seen["version"] = component.estimator_version

    # A printer that answers nonsense, then one that is right.
    Klipper.answer = b"\x00 no JSON"
    url = f"http://127.0.0.1:{server.port}/"
    seen["nonsense_is_refused"] = await is_refused(component._dump_estimator_config(component.default_config))
    seen["nonsense_config_exists"] = component.default_config.exists()
    seen["nonsense"] = errors(tool, "--config_moonraker_url", url, "--api_key", KEY, "dump-config")
    seen["wrong_key"] = errors(tool, "--config_moonraker_url", url, "--api_key", "other", "dump-config")
    Klipper.answer = good
    dumped = await component._dump_estimator_config(component.default_config)
    seen["dumped"] = sorted(dumped)
    component._update_gcode_proc_config()

    seen["estimated"] = await component.estimate_file(files[0])
    before = metadata(folder, names[0], [])
    seen["slicer_time_s"] = before["estimated_time"]
    seen["asked"] = [await component.post_process_file(files[0]) for _ in range(2)]
    seen["asked_time_s"] = metadata(folder, names[0], [])["estimated_time"]
    processors = [dict(config) for config in server.parts.processors.values()]
    uploaded = metadata(folder, names[1], processors)
    seen["uploaded"] = {key: uploaded[key] for key in ["estimated_time", "file_processors", "slicer"]}
    seen["same"] = files[0].read_bytes() == files[1].read_bytes()
    seen["file"] = str(files[1])

    # Limits that no printer has, in a file of klipper_estimator's kind.
    limits = {"max_velocity": 300, "max_acceleration": 3000, "max_accel_to_decel": 1500, "square_corner_velocity": 5}
    zero = folder / "config/zero.json"
    zero.write_text(json.dumps({**limits, "max_acceleration": 0}))
    kept = files[0].read_bytes()
    seen["zero_is_refused"] = await is_refused(component.post_process_file(files[0], zero, force=True))
    seen["zero"] = errors(tool, "--config_file", zero, "post-process", files[0])
    seen["kept"] = files[0].read_bytes() == kept
    own = folder / "config/own.json"
    own.write_text(json.dumps(limits))
    seen["own_limits"] = await component.estimate_file(files[0], own)
    seen["warnings"] = server.warnings
    return seen


def main():
    program, printer_cfg, file, folder = sys.argv[1:]
    os.environ["FERROSTEP"] = program
    print(json.dumps(asyncio.run(see(printer_cfg, file, pathlib.Path(folder)))))


main()
