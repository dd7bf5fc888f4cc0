#!/usr/bin/env python3
"""Takes the words of klipper_estimator, and lets ferrostep compute the time.

    klipper_estimator.py --version
    klipper_estimator.py CONFIGURATION estimate [-f json|human] FILE
    klipper_estimator.py CONFIGURATION post-process FILE
    klipper_estimator.py --config_moonraker_url URL [--config_moonraker_api_key KEY] dump-config

CONFIGURATION is --config_file FILE or --config_moonraker_url URL. A configuration file is one that dump-config has written, or one of
klipper_estimator's own with the printer's limits.

The command ferrostep is looked for in FERROSTEP, in PATH, and where cargo and pip put it for a user. Exit status 1 with a message on
standard error if anything is missing or wrong; no file is changed then.
"""

import argparse
import json
import math
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

# The key under which a configuration keeps the profile.
PROFILE = "ferrostep_profile"
# The name of the profile that a configuration keeps.
FILE = "file.toml"
# Of `ferrostep import --assume`: parts of the machine are assumed.
ASSUMED = 3
# Longer than the way of any printer, mm: klipper_estimator's configurations know no limits of the
# travel.
TRAVEL_MM = 1000

# Klipper's settings by klipper_estimator's names.
PRINTER = {
    "max_velocity": "max_velocity",
    "max_acceleration": "max_accel",
    "minimum_cruise_ratio": "minimum_cruise_ratio",
    "square_corner_velocity": "square_corner_velocity",
}
# Those that may be 0.
MAY_BE_ZERO = {"minimum_cruise_ratio", "max_accel_to_decel", "square_corner_velocity", "instant_corner_velocity"}


class Refused(Exception):
    """A reason for which nothing is done, for a person."""


def ferrostep():
    """The path of the command."""
    named = os.environ.get("FERROSTEP")
    home = pathlib.Path.home()
    places = [named] if named else [shutil.which("ferrostep"), home / ".cargo/bin/ferrostep", home / ".local/bin/ferrostep"]
    for place in places:
        if place and os.access(place, os.X_OK):
            return str(place)
    raise Refused("ferrostep is not found: install it, or name its path in the environment's FERROSTEP")


def run(arguments, accepted=(0,)):
    """Runs the command; returns what it prints."""
    done = subprocess.run([ferrostep(), *arguments], capture_output=True, text=True, errors="replace", check=False)
    if done.returncode not in accepted:
        reason = done.stderr.strip() or f"ferrostep {arguments[0]} ends with exit status {done.returncode}"
        raise Refused(reason.removeprefix("error: "))
    return done.stdout


def version():
    """The version, in the form in which Moonraker reads klipper_estimator's."""
    said = run(["--version"])
    number = re.search(r"\d+(\.\d+)+", said)
    if number is None:
        raise Refused(f"{ferrostep()} does not say its version but {said.strip()!r}: is it ferrostep?")
    return number.group()


def of_moonraker(url, key, folder):
    """The profile of a running printer."""
    profile = folder / "moonraker.toml"
    login = ["--api-key", key] if key else []
    run(["import", "--moonraker", url, *login, "--assume", "-o", str(profile)], accepted=(0, ASSUMED))
    return profile


def number(place, data, key):
    """A number of a configuration that is larger than 0, or may be 0; None without one."""
    value = data.get(key)
    if value is None:
        return None
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    if not is_number or value < 0 or (value == 0 and key not in MAY_BE_ZERO):
        wanted = "0 or more" if key in MAY_BE_ZERO else "more than 0"
        raise Refused(f"{place}: {key} is {json.dumps(value)}, expected a number, {wanted}: correct it, or write the file anew with dump-config")
    return value


def axis_limits(place, checker):
    """Klipper's settings for the limits of an axis or of the extruder."""
    name, limits = next(iter(checker.items()), (None, None)) if isinstance(checker, dict) else (None, None)
    if name not in ("axis_limiter", "extruder_limiter") or not isinstance(limits, dict):
        raise Refused(f"{place}: move_checkers has {json.dumps(checker)}, expected axis_limiter or extruder_limiter")
    velocity, accel = (number(f"{place}: {name}", limits, key) for key in ("max_velocity", "max_accel"))
    if velocity is None or accel is None:
        raise Refused(f"{place}: {name} has no max_velocity or no max_accel: write both")
    if name == "extruder_limiter":
        return "extruder", [("max_extrude_only_velocity", velocity), ("max_extrude_only_accel", accel)]
    axis = limits.get("axis")
    if axis not in ([1, 0, 0], [0, 1, 0], [0, 0, 1]):
        raise Refused(f"{place}: axis_limiter has the axis {json.dumps(axis)}, expected [1, 0, 0], [0, 1, 0] or [0, 0, 1]")
    letter = "xyz"[axis.index(1)]
    return "printer", [(f"max_{letter}_velocity", velocity), (f"max_{letter}_accel", accel)]


def printer_cfg(place, data):
    """Klipper's configuration of a machine with the limits of klipper_estimator's."""
    printer = [("kinematics", "cartesian")]
    extruder = []
    for key, setting in PRINTER.items():
        value = number(place, data, key)
        if value is not None:
            printer.append((setting, value))
    velocity = number(place, data, "instant_corner_velocity")
    if velocity is not None:
        extruder.append(("instantaneous_corner_velocity", velocity))
    accel, decel = (number(place, data, key) for key in ("max_acceleration", "max_accel_to_decel"))
    if accel is None or data.get("max_velocity") is None:
        raise Refused(f"{place}: no {PROFILE}, and no max_velocity and max_acceleration: write the file with dump-config")
    if decel is not None and "minimum_cruise_ratio" not in data:
        printer.append(("minimum_cruise_ratio", max(0.0, 1.0 - decel / accel)))
    for checker in data.get("move_checkers") or []:
        section, settings = axis_limits(place, checker)
        (printer if section == "printer" else extruder).extend(settings)
    steppers = [(f"stepper_{axis}", [("position_min", -TRAVEL_MM), ("position_max", TRAVEL_MM)]) for axis in "xyz"]
    sections = [("printer", printer), ("extruder", extruder), *steppers]
    return "".join(f"[{name}]\n" + "".join(f"{key}: {value}\n" for key, value in settings) + "\n" for name, settings in sections)


def of_file(path, folder):
    """The profile in a configuration file, or of its limits."""
    try:
        data = json.loads(pathlib.Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise Refused(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise Refused(f"{path}: not JSON ({error}): write the file anew with dump-config") from None
    if not isinstance(data, dict):
        raise Refused(f"{path}: expected an object of JSON: write the file anew with dump-config")
    profile = folder / FILE
    if PROFILE in data:
        profile.write_text(str(data[PROFILE]), encoding="utf-8")
        return profile
    limits = folder / "printer.cfg"
    limits.write_text(printer_cfg(path, data), encoding="utf-8")
    run(["import", str(limits), "--assume", "-o", str(profile)], accepted=(0, ASSUMED))
    return profile


def profile_of(arguments, folder):
    """The profile of a configuration; that of the running printer, where both are named."""
    if arguments.config_moonraker_url:
        return of_moonraker(arguments.config_moonraker_url, arguments.api_key, folder)
    if arguments.config_file:
        return of_file(arguments.config_file, folder)
    raise Refused("no configuration: give --config_file or --config_moonraker_url")


def estimate(arguments, profile):
    """Prints the time of a file: as a text, or as klipper_estimator's JSON as far as it is known."""
    if arguments.format == "human":
        return run(["estimate", "--profile", str(profile), "--", arguments.file])
    known = json.loads(run(["estimate", "--profile", str(profile), "--json", "--", arguments.file]))
    sequence = {
        "total_time": known["print_time_s"],
        "total_extrude_distance": known["filament_mm"],
        "num_moves": known["moves"],
    }
    return json.dumps({"sequences": [sequence]}, indent=2) + "\n"


def post_process(arguments, profile):
    """Writes the time into a file, and the mark by which Moonraker knows it."""
    mark = f"Processed by klipper_estimator {version()} (ferrostep)"
    return run(["post-process", "--profile", str(profile), "--mark", mark, "--", arguments.file])


def dump_config(arguments, profile):
    """Prints a configuration file."""
    if not arguments.config_moonraker_url and not arguments.config_file:
        raise Refused("no printer: give --config_moonraker_url")
    return json.dumps({PROFILE: profile.read_text(encoding="utf-8")}, indent=2) + "\n"


def parsed(arguments):
    """The arguments, with klipper_estimator's words."""
    parser = argparse.ArgumentParser(prog="klipper_estimator", description="Lets ferrostep compute what klipper_estimator would.")
    parser.add_argument("--version", "-V", action="store_true")
    parser.add_argument("--config_file")
    parser.add_argument("--config_moonraker_url")
    parser.add_argument("--config_moonraker_api_key", "--api_key", dest="api_key")
    commands = parser.add_subparsers(dest="command")
    of_estimate = commands.add_parser("estimate")
    of_estimate.add_argument("--format", "-f", type=str.lower, choices=["human", "json"], default="human")
    of_estimate.add_argument("file")
    commands.add_parser("post-process").add_argument("file")
    commands.add_parser("dump-config")
    found = parser.parse_args(arguments)
    if not found.version and found.command is None:
        parser.error("expected estimate, post-process or dump-config")
    return found


def main():
    """Runs the command; the exit status."""
    arguments = parsed(sys.argv[1:])
    acts = {"estimate": estimate, "post-process": post_process, "dump-config": dump_config}
    try:
        if arguments.version:
            print(f"klipper_estimator {version()} (ferrostep)")
            return 0
        with tempfile.TemporaryDirectory(prefix="ferrostep-") as name:
            folder = pathlib.Path(name)
            try:
                result = acts[arguments.command](arguments, profile_of(arguments, folder))
            except Refused as reason:
                # The profile's file is gone when a person reads this.
                raise Refused(str(reason).replace(str(folder / FILE), f"{arguments.config_file}, {PROFILE}")) from None
        sys.stdout.write(result)
        return 0
    except Refused as reason:
        print(f"error: {reason}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
