"""The command: where it is, and how it is run."""

import json
import os
import shutil
import subprocess
import sysconfig
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence


class FerrostepError(Exception):
    """The command has refused something; the text is its own."""


class CannotStart(FerrostepError):
    """Nothing was started: wrong arguments, an unreadable file, a profile with a mistake, or the command is missing."""


class JobStopped(FerrostepError):
    """The job stopped at a line.

    ``line`` is its number, where the command names one, and ``report`` the figures up to there, where it has some.
    """

    def __init__(self, message: str, line: Optional[int] = None, report: Optional[Dict[str, Any]] = None) -> None:
        super().__init__(message)
        self.line = line
        self.report = report


def command() -> Path:
    """The program that this wheel has installed, or else the first ``ferrostep`` on the path.

    Raises :class:`CannotStart` if there is none.
    """
    name = "ferrostep" + (sysconfig.get_config_var("EXE") or "")
    schemes = [None, f"{os.name}_user"]
    folders = [
        sysconfig.get_path("scripts", scheme) if scheme else sysconfig.get_path("scripts")
        for scheme in schemes
        if scheme is None or scheme in sysconfig.get_scheme_names()
    ]
    # `pip install --target` puts programs beside the packages.
    folders.append(str(Path(__file__).resolve().parent.parent / "bin"))
    for folder in folders:
        program = Path(folder) / name
        if program.is_file():
            return program
    found = shutil.which("ferrostep")
    if found is None:
        raise CannotStart(f"{name} is missing: it is in none of {', '.join(folders)}, nor on the path; install the wheel again")
    return Path(found)


def run(arguments: Sequence[str]) -> str:
    """Runs the command; its standard output."""
    done = _done(arguments)
    if done.returncode != 0:
        raise _refusal(done, None)
    return done.stdout


def run_for_json(arguments: Sequence[str]) -> Dict[str, Any]:
    """Runs the command with ``--json``; the object that it prints."""
    done = _done([*arguments, "--json"])
    report = None
    if done.stdout.strip():
        try:
            report = json.loads(done.stdout)
        except ValueError as error:
            raise FerrostepError(f"ferrostep {arguments[0]}: its output is no JSON: {error}") from error
    if done.returncode != 0:
        raise _refusal(done, report)
    if not isinstance(report, dict):
        raise FerrostepError(f"ferrostep {arguments[0]}: its output is no JSON object")
    return report


def _done(arguments: Sequence[str]) -> "subprocess.CompletedProcess[str]":
    program = command()
    try:
        return subprocess.run(
            [str(program), *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            check=False,
        )
    except (OSError, ValueError) as error:
        raise CannotStart(f"{program}: {error}") from error


def _refusal(done: "subprocess.CompletedProcess[str]", report: Optional[Dict[str, Any]]) -> FerrostepError:
    """The exception for an exit status: 1 is a job that stopped, as the command's manual has it."""
    message = _error_of(done.stderr) or f"ferrostep ended with status {done.returncode}"
    if done.returncode != 1:
        return CannotStart(message)
    stopped = (report or {}).get("stopped")
    line = stopped.get("line") if isinstance(stopped, dict) else None
    return JobStopped(message, line, report)


def _error_of(said: str) -> str:
    """The error in what was said on standard error: from its last line that begins with ``error: ``."""
    lines: List[str] = said.strip().splitlines()
    starts = [number for number, line in enumerate(lines) if line.startswith("error: ")]
    if not starts:
        return said.strip()
    return "\n".join(lines[starts[-1] :])[len("error: ") :].strip()
