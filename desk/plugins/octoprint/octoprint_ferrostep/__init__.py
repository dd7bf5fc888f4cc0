"""OctoPrint's analysis of G-code with ferrostep's time."""

import octoprint.plugin

from .estimate import Estimate, EstimateFailed, version_of
from .queue import FerrostepQueue

__plugin_name__ = "Ferrostep"
__plugin_pythoncompat__ = ">=3.9,<4"


class FerrostepPlugin(
    octoprint.plugin.StartupPlugin,
    octoprint.plugin.SettingsPlugin,
    octoprint.plugin.TemplatePlugin,
):
    """Settings, and the queue that replaces OctoPrint's own for G-code."""

    def get_settings_defaults(self):
        return {"command": "ferrostep", "profile": "", "options": ""}

    def get_settings_restricted_paths(self):
        # They name files and programs of this computer.
        return {"admin": [["command"], ["profile"], ["options"]]}

    def get_template_configs(self):
        return [{"type": "settings", "custom_bindings": False}]

    def is_template_autoescaped(self):
        return True

    def on_after_startup(self):
        try:
            self._logger.info("estimates are made by %s", version_of(self._settings.get(["command"])))
        except EstimateFailed as error:
            self._logger.warning("OctoPrint's own times stay: %s", error)

    def queues(self, *args, **kwargs):
        """The analysis queues of this plug-in, by type of file."""
        return {"gcode": lambda finished_callback: FerrostepQueue(finished_callback, self)}

    def estimate(self, file):
        """Starts an estimate of a file, by the settings of now."""
        get = self._settings.get
        return Estimate(get(["command"]), file, get(["profile"]), get(["options"]))

    @property
    def log(self):
        """The plug-in's part of `octoprint.log`."""
        return self._logger


def __plugin_load__():
    global __plugin_implementation__, __plugin_hooks__
    __plugin_implementation__ = FerrostepPlugin()
    __plugin_hooks__ = {"octoprint.filemanager.analysis.factory": __plugin_implementation__.queues}
