"""The plug-in of OrcaSlicer on a stand-in of the module `orca`, made from the pages of its interface.

    orcaslicer_plugin.py COMMAND FILE...

Prints, for each file, the result of the export and what the tab is told.
"""

import importlib.util
import json
import sys
import types
from pathlib import Path

PLUGIN = Path(__file__).parents[2] / "desk/plugins/orcaslicer/ferrostep_show.py"


class Capability:
    config = "{}"

    def get_config(self):
        return self.config

    def post_message(self, data):
        self.told = json.loads(json.dumps(data))


class Result:
    @staticmethod
    def success(message="", data=""):
        return ["success", message]

    @staticmethod
    def skipped(message=""):
        return ["skipped", message]


def stand_in():
    orca, registered = types.ModuleType("orca"), []
    orca.base, orca.ExecutionResult = object, Result
    orca.plugin = lambda package: package
    orca.register_capability = registered.append
    step = types.SimpleNamespace(posSlice=1, psGCodePostProcess=2)
    orca.slicing = types.SimpleNamespace(SlicingPipelineCapabilityBase=Capability, Step=step)
    orca.pages = types.SimpleNamespace(PagesPluginCapabilityBase=Capability)
    return orca, registered


def main():
    orca, registered = stand_in()
    sys.modules["orca"] = orca
    spec = importlib.util.spec_from_file_location("ferrostep_show", PLUGIN)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.Ferrostep().register_capabilities()
    export, tab = (capability() for capability in registered)
    context = types.SimpleNamespace(step=orca.slicing.Step.posSlice, gcode_path=None)
    seen = {"early": export.execute(context), "frame": tab.get_ui(), "files": []}
    context.step = orca.slicing.Step.psGCodePostProcess
    exports = [(sys.argv[1], file) for file in sys.argv[2:]] + [("no-such-command", sys.argv[2])]
    for number, (command, file) in enumerate(exports):
        export.config = json.dumps({"command": command})
        context.gcode_path = file
        before = sorted(Path(file).parent.iterdir())
        result = export.execute(context)
        tab.told = None
        tab.on_message({"shown": number})
        told = tab.told
        tab.told = None
        tab.on_message({"shown": number + 1})
        is_clean = sorted(Path(file).parent.iterdir()) == before
        seen["files"].append({"result": result, "told": told, "again": tab.told, "is_clean": is_clean})
    print(json.dumps(seen))


if __name__ == "__main__":
    main()
