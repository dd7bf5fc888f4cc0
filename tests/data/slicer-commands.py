"""Lists the commands of the start, end, layer, tool-change, colour-change and pause G-code of the printer profiles that
PrusaSlicer and Cura bring: one line for all machines with the same commands, each command once, without moves and without
comments. Moves stay only where something about their words is odd. Each condition of a template is taken once and once not.

Columns: number of machines, the first of them, the commands between " | ".

To refresh slicer-commands.tsv, install Debian's packages prusa-slicer and cura (the file was made from 2.5 and 4.13) and run

    python3 slicer-commands.py /usr/share/PrusaSlicer/profiles /usr/share/cura/resources/definitions > slicer-commands.tsv

then refresh what the test holds: FERROSTEP_REFRESH=1 cargo test -p ferrostep-tests slicer_profiles
"""
import configparser, glob, json, os, re, sys

KEYS = ["start_gcode", "end_gcode", "before_layer_gcode", "layer_gcode", "toolchange_gcode", "color_change_gcode",
        "pause_print_gcode", "template_custom_gcode", "between_objects_gcode"]

def value_of(placeholder):
    """A number that such a placeholder could have."""
    name = placeholder.lower()
    if "bed" in name: return "60"
    if "chamber" in name or "build_volume" in name: return "40"
    if "temp" in name: return "210"
    if "layer_num" in name: return "1"
    if "layer_z" in name or "height" in name: return "0.2"
    if "extruder" in name or "tool" in name: return "0"
    return "10"

def commands(text):
    tag = r"\{(?:if|elsif|else|endif|local|global)\b[^}]*\}"
    first = re.sub(tag, "", re.sub(r"\{(?:else|elsif)\b.*?\{endif\}", "", text, flags=re.S))
    second = re.sub(tag, "", re.sub(r"\{if\b[^}]*\}(?:(?!\{endif).)*?\{(?:else|elsif)\b[^}]*\}", "", text, flags=re.S))
    text = first + "\n" + second # each condition once taken and once not
    text = re.sub(r"\{[^{}]*\}|\[[a-z_0-9]+(\[[^\]]*\])?\]", lambda m: value_of(m.group(0)), text)
    found = set()
    for line in text.replace("\r", "\n").split("\n"):
        line = line.split(";")[0].strip()
        line = re.sub(r"\s+", " ", line)
        if not line: continue
        word = line.split(" ")[0].upper()
        # An arc, which begins where the move before it ends.
        if re.fullmatch(r"G0*[23]", word): continue
        if re.fullmatch(r"G0*[01]", word): # a move: only what it names
            if not re.search(r"[XYZEF]", line.upper()[2:]) or re.search(r"[XYZEF](?![-+.\d])", line.upper()): found.add(line)
            continue
        if word in ("M117", "M118"): line = word + " message"
        if len(line) > 60: line = line[:60]
        found.add(line.replace("|", "/"))
    return sorted(found)

def prusa(folder):
    for path in sorted(glob.glob(folder + "/*.ini")):
        parser = configparser.RawConfigParser(strict=False, delimiters=("=",), comment_prefixes=("#",), interpolation=None)
        parser.optionxform = str
        parser.read(path, encoding="utf-8")
        sections = {s[len("printer:"):]: dict(parser.items(s)) for s in parser.sections() if s.startswith("printer:")}
        def resolved(name, seen=()):
            own = sections.get(name)
            if own is None or name in seen: return {}
            out = {}
            for parent in own.get("inherits", "").split(";"):
                if parent.strip(): out.update(resolved(parent.strip(), seen + (name,)))
            out.update(own)
            return out
        for name in sorted(sections):
            if name.startswith("*"): continue
            profile = resolved(name)
            if not profile.get("gcode_flavor", "marlin").startswith("marlin"): continue
            if profile.get("printer_technology") == "SLA": continue
            text = "\n".join(profile.get(k, "").strip('"').replace("\\n", "\n").replace('\\"', '"') for k in KEYS)
            yield "PrusaSlicer", os.path.basename(path)[:-4] + "/" + name, commands(text)

def cura(folder):
    files = {os.path.basename(p)[:-len(".def.json")]: p for p in glob.glob(folder + "/*.def.json")}
    loaded = {}
    def load(name):
        if name not in loaded: loaded[name] = json.load(open(files[name], encoding="utf-8")) if name in files else {}
        return loaded[name]
    def setting(name, key):
        while name:
            d = load(name)
            entry = d.get("overrides", {}).get(key)
            if entry is None:
                stack = list(d.get("settings", {}).items())
                while stack:
                    k, v = stack.pop()
                    if k == key: entry = v; break
                    stack.extend(v.get("children", {}).items())
            if entry is not None:
                if isinstance(entry.get("value"), str) and not re.search(r"[a-z_]+\(|resolveOrValue", entry["value"]) and entry["value"][:1] in "'\"":
                    try: return str(eval(entry["value"], {"__builtins__": {}}))
                    except Exception: pass
                if "default_value" in entry: return str(entry["default_value"])
            name = d.get("inherits")
        return ""
    for name in sorted(files):
        d = load(name)
        if not d.get("metadata", {}).get("visible"): continue
        if "Marlin" not in setting(name, "machine_gcode_flavor"): continue
        yield "Cura", d.get("name", name), commands(setting(name, "machine_start_gcode") + "\n" + setting(name, "machine_end_gcode"))

# Machines whose commands are the same share a line: how many, the first of them, the commands.
sets = {}
for slicer, machine, found in [*prusa(sys.argv[1]), *cura(sys.argv[2])]:
    sets.setdefault(" | ".join(found), []).append(f"{slicer}: {machine}")
for found, machines in sorted(sets.items(), key=lambda entry: (-len(entry[1]), entry[0])):
    if found: print(len(machines), machines[0], found, sep="\t")
