"""The command ``ferrostep estimate`` for one file. It knows nothing of OctoPrint."""

import json
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

# A file of 100 MB takes about a minute on a small computer.
PATIENCE_S = 600


class EstimateFailed(Exception):
    """The command has no time for the file; the text says why."""


class Estimate:
    """A run of the command, which another thread may end."""

    def __init__(self, command, file, profile, options):
        try:
            further = shlex.split(options or "")
        except ValueError as error:
            raise EstimateFailed(f"the options {options!r}: {error}; mend them in the plug-in's settings") from error
        machine = ["--profile", profile] if profile else []
        arguments = [program(command), "estimate", str(file), *machine, *further, "--json"]
        self._process = started(arguments)

    def end(self):
        """Ends the run; :meth:`time_s` then fails."""
        self._process.kill()

    def time_s(self):
        """Waits for the time, in seconds."""
        said, errors = finished(self._process)
        if self._process.returncode != 0:
            # Notes may precede the error.
            reason = errors.strip()
            reason = reason.partition("error: ")[2] or reason
            raise EstimateFailed(reason or f"ferrostep ended with status {self._process.returncode}")
        try:
            return float(json.loads(said)["print_time_s"])
        except (ValueError, KeyError, TypeError) as error:
            raise EstimateFailed(f"its report has no print_time_s: {error}") from error


def version_of(command):
    """The command's name and version."""
    process = started([program(command), "--version"])
    said, errors = finished(process)
    if process.returncode != 0:
        raise EstimateFailed(errors.strip() or f"--version ended with status {process.returncode}")
    return said.strip()


def program(command):
    """The command as a path: as it stands, on the path, or in the environment that OctoPrint runs in."""
    command = command or "ferrostep"
    own = shutil.which(command, path=str(Path(sys.executable).parent))
    return shutil.which(command) or own or command


def started(arguments):
    try:
        return subprocess.Popen(
            arguments, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8", errors="replace"
        )
    except (OSError, ValueError) as error:
        raise EstimateFailed(f"{arguments[0]}: {error}; set the command's path in the plug-in's settings") from error


def finished(process):
    """Standard output and standard error of a process, once it has ended."""
    try:
        return process.communicate(timeout=PATIENCE_S)
    except subprocess.TimeoutExpired as error:
        process.kill()
        process.communicate()
        raise EstimateFailed(f"no answer within {PATIENCE_S} s") from error
