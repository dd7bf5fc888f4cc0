"""Rehearses 3D prints: the command ``ferrostep`` as functions with typed results.

Each function runs the command that the same wheel has installed, and waits for it. What the command refuses becomes an exception with
its words.
"""

import os
from pathlib import Path
from typing import Mapping, Optional, Sequence, Union

from ._command import CannotStart, FerrostepError, JobStopped, command, run, run_for_json
from ._results import Comparison, Estimate, Page, Remark, Side

__all__ = [
    "CannotStart",
    "Comparison",
    "Estimate",
    "FerrostepError",
    "JobStopped",
    "Page",
    "Remark",
    "Side",
    "command",
    "compare",
    "estimate",
    "show",
]

PathLike = Union[str, "os.PathLike[str]"]


def estimate(
    file: PathLike, *, profile: Optional[PathLike] = None, plate: Optional[int] = None, options: Sequence[str] = ()
) -> Estimate:
    """Estimates the time and the material that a file takes.

    ``profile`` is ``cartesian``, ``corexy``, ``prusa-mini``, or the path of a profile; without it the machine is that of the file's
    comments. ``plate`` chooses one of a sliced 3MF. ``options`` are further ones of ``ferrostep estimate``, as a shell passes them.

    Raises :class:`JobStopped` at a line that the printer would refuse, :class:`CannotStart` for everything else.
    """
    arguments = ["estimate", *_job(file, plate, profile), *options]
    return Estimate.of(run_for_json(arguments))


def show(
    file: PathLike,
    page: PathLike,
    *,
    profile: Optional[PathLike] = None,
    plate: Optional[int] = None,
    options: Sequence[str] = (),
) -> Page:
    """Prints a file on the virtual printer and writes ``page``, one HTML file that needs no server.

    Raises :class:`JobStopped` at a line that the printer would refuse; the page then shows the print up to there.
    """
    arguments = ["show", *_job(file, plate, profile), "-o", os.fspath(page), "--no-open", *options]
    return Page(path=Path(page), summary=run(arguments).strip())


def compare(
    a: PathLike,
    b: Optional[PathLike] = None,
    *,
    page: Optional[PathLike] = None,
    profile: Optional[PathLike] = None,
    profile_b: Optional[PathLike] = None,
    settings: Optional[Mapping[str, float]] = None,
    frequency_x_hz: Optional[float] = None,
    frequency_y_hz: Optional[float] = None,
    plate: Optional[int] = None,
    options: Sequence[str] = (),
) -> Comparison:
    """Prints two files, or one with two profiles, and compares time, speed, flow and error.

    Without ``b`` the first file is printed twice: the second time with ``profile_b``, or with ``settings`` in place of the profile's keys.
    With a frequency of the frame the contour error is measured, too. ``page`` is an HTML file to write with both prints.

    Raises :class:`JobStopped` if either print stops, :class:`CannotStart` for everything else.
    """
    arguments = ["compare", *_job(a, plate, profile), "--no-open", *options]
    if b is not None:
        arguments.append(_path(b))
    for name, value in (("-o", page), ("--profile-b", profile_b)):
        if value is not None:
            arguments += [name, os.fspath(value)]
    for name, hertz in (("--frequency-x", frequency_x_hz), ("--frequency-y", frequency_y_hz)):
        if hertz is not None:
            arguments += [name, repr(float(hertz))]
    for key, setting in (settings or {}).items():
        arguments += ["--set", f"{key}={float(setting)!r}"]
    return Comparison.of(run_for_json(arguments))


def _path(file: PathLike) -> str:
    """A file's path that the command takes for one: a leading hyphen would be an option, or standard input."""
    path = os.fspath(file)
    return os.path.join(os.curdir, path) if path.startswith("-") else path


def _job(file: PathLike, plate: Optional[int], profile: Optional[PathLike]) -> "list[str]":
    """The arguments that name a job and its machine."""
    arguments = [_path(file)]
    if plate is not None:
        arguments += ["--plate", str(plate)]
    if profile is not None:
        arguments += ["--profile", os.fspath(profile)]
    return arguments
