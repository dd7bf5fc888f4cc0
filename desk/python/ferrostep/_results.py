"""What the functions return."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Dict, Mapping, Optional, Tuple


@dataclass(frozen=True)
class Remark:
    """A remark about the job: a line without effect, a move outside the travel, too much flow, and others."""

    kind: str
    message: str
    count: int
    """Number of lines that it holds for."""
    lines: Tuple[int, ...]
    """The first of these lines."""


@dataclass(frozen=True)
class Estimate:
    """Time and material of a job. Times in s, lengths in mm."""

    file: str
    profile: str
    print_time_s: float
    """From the first line to the last step, with homing and waits for heat."""
    motion_time_s: float
    """Of the moves alone, homing left out."""
    filament_mm: float
    lines: int
    moves: int
    layers: int
    slicer_time_s: Optional[float]
    """The slicer's own time, where the file says it."""
    remarks: Tuple[Remark, ...]
    report: Mapping[str, Any] = field(repr=False, compare=False)
    """Everything that ``ferrostep estimate --json`` prints."""

    @classmethod
    def of(cls, report: Dict[str, Any]) -> "Estimate":
        """Takes the command's report."""
        remarks = tuple(
            Remark(remark["kind"], remark["message"], remark["count"], tuple(remark["lines"]))
            for remark in report.get("remarks") or ()
        )
        return cls(
            file=report["file"],
            profile=report["profile"],
            print_time_s=report["print_time_s"],
            motion_time_s=report["motion_time_s"],
            filament_mm=report["filament_mm"],
            lines=report["lines"],
            moves=report["moves"],
            layers=report["layers"],
            slicer_time_s=report.get("slicer_time_s"),
            remarks=remarks,
            report=report,
        )


@dataclass(frozen=True)
class Page:
    """A page that was written."""

    path: Path
    summary: str
    """The command's line about it: time, moves, findings."""


@dataclass(frozen=True)
class Side:
    """One print of a comparison. Times in s, lengths in mm, speeds in mm/s, flow in mm³/s."""

    file: str
    profile: str
    print_time_s: float
    printing_s: float
    travelling_s: float
    mean_printing_mm_per_s: float
    max_printing_mm_per_s: float
    mean_flow_mm3_per_s: float
    max_flow_mm3_per_s: float
    filament_mm: float
    max_deviation_mm: float
    contour_error_um: Optional[Mapping[str, float]]
    """Distance of the nozzle from the path on a frame that rings; ``None`` without a frequency."""
    report: Mapping[str, Any] = field(repr=False, compare=False)
    """Everything that the command prints of this side."""

    @classmethod
    def of(cls, report: Dict[str, Any]) -> "Side":
        """Takes one side of the command's report."""
        return cls(
            file=report["file"],
            profile=report["profile"],
            print_time_s=report["print_time_s"],
            printing_s=report["printing_s"],
            travelling_s=report["travelling_s"],
            mean_printing_mm_per_s=report["mean_printing_mm_per_s"],
            max_printing_mm_per_s=report["max_printing_mm_per_s"],
            mean_flow_mm3_per_s=report["mean_flow_mm3_per_s"],
            max_flow_mm3_per_s=report["max_flow_mm3_per_s"],
            filament_mm=report["filament_mm"],
            max_deviation_mm=report["max_deviation_mm"],
            contour_error_um=report.get("contour_error_um"),
            report=report,
        )


@dataclass(frozen=True)
class Comparison:
    """Two prints beside each other."""

    a: Side
    b: Side

    @classmethod
    def of(cls, report: Dict[str, Any]) -> "Comparison":
        """Takes the command's report."""
        return cls(a=Side.of(report["a"]), b=Side.of(report["b"]))
