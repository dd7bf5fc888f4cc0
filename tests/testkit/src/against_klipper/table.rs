//! Time and error of files by this firmware's steps and by Klipper's rules.
#![allow(clippy::unwrap_used, reason = "files and plans of the repository")]

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::thread;

use ferrostep_analysis::simulation::{FilterWords, Simulation};
use ferrostep_oracle::gcode_text;
use ferrostep_planner::ShaperKind;
use ferrostep_profiles::PlannedBy;
use ferrostep_session::rules::RuledMachine;
use ferrostep_simulator::frame::{FrameSettings, SecondMode};
use ferrostep_simulator::measures::Report;
use ferrostep_simulator::plan::{ExtruderFilter, Filters, Machine};
use ferrostep_simulator::shapers::Shaper;

/// A file and the machine that it is planned for.
#[derive(Clone, Debug)]
pub struct Case {
    /// Name in the table's first column.
    pub name: String,
    /// G-code, plain or gzip.
    pub file: PathBuf,
    /// A profile's name or path.
    pub profile: String,
    /// Per cent of the file's speeds (M220).
    pub feed_percent: u32,
    /// The frequencies that the filters are made for, Hz.
    pub frequency_hz: [f64; 2],
}

impl Case {
    /// A file on the fast bed slinger, at four times its speeds.
    pub fn bed_slinger(root: &Path, name: &str, file: &Path) -> Self {
        Self {
            name: name.to_owned(),
            file: file.to_owned(),
            profile: root.join("tests/data/fast-bed-slinger.toml").to_str().unwrap().to_owned(),
            feed_percent: 400,
            frequency_hz: [50.0, 40.0],
        }
    }

    /// A file on the CoreXY, at its own speeds.
    pub fn corexy(name: &str, file: &Path) -> Self {
        Self {
            name: name.to_owned(),
            file: file.to_owned(),
            profile: "corexy".to_owned(),
            feed_percent: 100,
            frequency_hz: [60.0, 50.0],
        }
    }

    /// The job: the file's speeds by a factor, and without its own limits, so that those of the
    /// profile hold for both plans.
    fn job(&self) -> Vec<u8> {
        let text = gcode_text(&std::fs::read(&self.file).unwrap()).unwrap();
        let mut job = format!("M220 S{}\n", self.feed_percent).into_bytes();
        for line in text.split_inclusive(|byte| *byte == b'\n') {
            if !matches!(line, [b'M', b'2', b'0', b'1'..=b'5', ..]) {
                job.extend_from_slice(line);
            }
        }
        job
    }
}

/// The plans, in the order of the rows.
pub const PLANS: [Plan; 6] = [
    Plan::Ferrostep,
    Plan::CloserFerrostep,
    Plan::BudgetFerrostep,
    Plan::TolerantFerrostep,
    Plan::Klipper,
    Plan::TunedKlipper,
];

/// The error budget of [`Plan::BudgetFerrostep`], mm.
const BUDGET_MM: f64 = 0.04;

/// The tolerance of the filtered path of [`Plan::TolerantFerrostep`], mm.
const TOLERANCE_MM: f64 = 0.1;

/// Rules of a plan: Ferrostep's or Klipper's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plan {
    /// The steps of this firmware with the profile's junction deviation.
    Ferrostep,
    /// The same with a quarter of it.
    CloserFerrostep,
    /// This firmware's steps with the profile's junction deviation, and accelerations that follow
    /// from an error budget of 0.04 mm on a frame that is known to 5 %.
    BudgetFerrostep,
    /// This firmware's steps with the profile's junction deviation, and a filtered path that keeps
    /// a tolerance of 0.1 mm.
    TolerantFerrostep,
    /// Klipper's rules with its defaults.
    Klipper,
    /// Klipper's rules as its users set them who want time: corners at 10 mm/s, no minimum cruise.
    TunedKlipper,
}

impl Plan {
    const fn name(self) -> &'static str {
        match self {
            Self::Ferrostep => "Ferrostep, 0.02 mm",
            Self::CloserFerrostep => "Ferrostep, 0.005 mm",
            Self::BudgetFerrostep => "Ferrostep, budget",
            Self::TolerantFerrostep => "Ferrostep, tolerance",
            Self::Klipper => "Klipper",
            Self::TunedKlipper => "Klipper, tuned",
        }
    }
}

/// The filters, in the order of the rows.
pub const KINDS: [ShaperKind; 2] = [ShaperKind::Zv, ShaperKind::Mzv];

/// A frame beside the one that the filters are made for: its difference in per cent, and whether it
/// has a second mode.
pub type Off = (f64, bool);

/// The frames, in the order of the columns.
pub const FRAMES: [Off; 6] = [(0.0, false), (-5.0, false), (5.0, false), (-10.0, false), (10.0, false), (0.0, true)];

/// A measurement.
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    /// Plan of the row.
    pub plan: Plan,
    /// The filter of X and Y.
    pub kind: ShaperKind,
    /// The frame.
    pub off: Off,
}

/// Time, s, and the error that 99 % of the time stays below, um.
pub type Figures = (f64, f64);

/// A profile with the budget, the filter and a frame known to 5 %.
fn with_budget(text: &str, case: &Case, kind: ShaperKind) -> String {
    let mut text = format!("error_budget_mm = {BUDGET_MM}\n{text}");
    for (axis, hz) in ["x", "y"].into_iter().zip(case.frequency_hz) {
        let (uncertainty_hz, damping) = (0.05 * hz, FrameSettings::USUAL.damping);
        let _ = write!(
            text,
            "\n[frame.{axis}]\nfrequency_hz = {hz}\nfrequency_uncertainty_hz = {uncertainty_hz}\ndamping = {damping}\n\
             [input_shaper.{axis}]\nkind = \"{kind}\"\nfrequency_hz = {hz}\n"
        );
    }
    text
}

/// Plays a case's job, which is the file at `job`.
///
/// # Panics
/// The profile or the job cannot be read.
pub fn measure(case: &Case, job: &Path, cell: Cell) -> Figures {
    let text = ferrostep_profiles::text(&case.profile).unwrap();
    let text = if cell.plan == Plan::BudgetFerrostep { with_budget(&text, case, cell.kind) } else { text };
    let mut profile = ferrostep_profiles::parse(&text, &case.profile).unwrap();
    assert_eq!(profile.limits.junction_deviation_mm, 0.02, "{}", case.profile);
    if cell.plan == Plan::TolerantFerrostep {
        profile.motion.path_tolerance_mm = Some(TOLERANCE_MM);
    }
    if cell.plan == Plan::CloserFerrostep {
        profile.limits.junction_deviation_mm = 0.005;
    }
    let mut simulation = Simulation::open(job, profile, None, false).unwrap();
    simulation.leave_out_relative_ringing();
    let (percent, has_second) = cell.off;
    let words = FilterWords {
        input_shaper: Some(cell.kind),
        shaper_frequency_hz: Some(case.frequency_hz),
        detune_percent: Some(percent),
        is_compared: true,
        ..FilterWords::default()
    };
    let filters = simulation.filters(&words).unwrap();
    let second = has_second.then(SecondMode::default);
    let frame = FrameSettings { frequency_hz: filters.frame_hz, second, ..FrameSettings::USUAL };
    let machine = Machine { frame, ..Machine::default() };
    let klipper = |corner_mm_per_s: f64, cruise_ratio: f64| -> Report {
        let by = RuledMachine::parse(&text, &case.profile, Some(PlannedBy::Klipper)).unwrap().by.unwrap();
        let by = by.with_klippers_corners(Some(corner_mm_per_s), Some(cruise_ratio), Some(1.0)).unwrap();
        let filter = filters.compared.unwrap();
        let shapers = [0, 1]
            .map(|axis: usize| Shaper::new(filter.kind, filter.frequency_hz[axis], filter.damping[axis]).unwrap());
        let filters = Filters { shapers, extruder: ExtruderFilter::klipper(0.0, 0.04) };
        simulation.by_rules(&machine, by, &filters).unwrap().0.0
    };
    let report = match cell.plan {
        Plan::Klipper => klipper(5.0, 0.5),
        Plan::TunedKlipper => klipper(10.0, 0.0),
        Plan::Ferrostep | Plan::CloserFerrostep | Plan::BudgetFerrostep | Plan::TolerantFerrostep => {
            simulation.set_filters(filters.steps);
            let ((report, _), stopped) = simulation.run(&machine, |_| {}).unwrap();
            assert!(stopped.is_none(), "{}: {stopped:?}", case.name);
            report
        }
    };
    (report.time_s, report.contour_error_um.p99)
}

/// Writes the case's job into a folder and returns its path.
///
/// # Panics
/// A file cannot be read or written.
pub fn write_job(case: &Case, folder: &Path) -> PathBuf {
    let path = folder.join(format!("{}.gcode", case.name.replace(' ', "-")));
    std::fs::write(&path, case.job()).unwrap();
    path
}

/// The table in Markdown, made by `threads` threads.
///
/// # Panics
/// A profile or a job cannot be read.
pub fn table(cases: &[Case], threads: usize) -> String {
    let folder = tempfile::tempdir().unwrap();
    let jobs: Vec<_> = cases.iter().map(|case| (case, write_job(case, folder.path()))).collect();
    let mut cells = Vec::new();
    for index in 0..cases.len() {
        for kind in KINDS {
            cells.extend(PLANS.iter().flat_map(|plan| FRAMES.map(|off| (index, Cell { plan: *plan, kind, off }))));
        }
    }
    let mut figures = vec![(0.0, 0.0); cells.len()];
    let waiting = Mutex::new(cells.iter().zip(&mut figures));
    thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let next = waiting.lock().unwrap().next();
                    let Some(((index, cell), place)) = next else { return };
                    let (case, job) = &jobs[*index];
                    *place = measure(case, job, *cell);
                    eprintln!("{}, {:?}: {place:?}", case.name, cell);
                }
            });
        }
    });
    let mut text = "| file | plan | filter | time, s | f | -5 % | +5 % | -10 % | +10 % | second mode |\n".to_owned();
    text.push_str("|---|---|---|---|---|---|---|---|---|---|\n");
    for (row, figures) in cells.chunks(FRAMES.len()).zip(figures.chunks(FRAMES.len())) {
        let (index, Cell { plan, kind, .. }) = row[0];
        text.push_str(&row_of(&cases[index].name, plan, kind, figures));
    }
    text
}

/// Start of a row.
pub fn row_start(name: &str, plan: Plan, kind: ShaperKind) -> String {
    format!("| {name} | {} | `{kind}` |", plan.name())
}

fn row_of(name: &str, plan: Plan, kind: ShaperKind, figures: &[Figures]) -> String {
    let mut row = row_start(name, plan, kind);
    // The time is the filters' and the plan's, whatever the frame.
    let (time_s, _) = figures[0];
    assert!(figures.iter().all(|(other_s, _)| *other_s == time_s), "{row} {figures:?}");
    let _ = write!(row, " {time_s:.1} |");
    for (_, p99_um) in figures {
        let _ = write!(row, " {p99_um:.0} |");
    }
    row.push('\n');
    row
}
