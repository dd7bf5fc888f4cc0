//! The page: its text, styles and programs, with a print's data, in one file.

use std::io::{self, Write};

use serde::Serialize;
use sha2::{Digest, Sha256};

use crate::columns::{Column, Columns, base64, packed};
use crate::findings::Finding;
use crate::recorder::Recording;
use crate::source::Text;
use crate::totals::Totals;

const PAGE: &str = include_str!("../page/page.html");
const STYLE: &str = include_str!("../page/page.css");
const SCRIPT: &str = concat!(
    "'use strict';\n(() => {\n",
    include_str!("../page/data.js"),
    include_str!("../page/rest.js"),
    include_str!("../page/features.js"),
    include_str!("../page/colours.js"),
    include_str!("../page/limits.js"),
    include_str!("../page/places.js"),
    include_str!("../page/camera.js"),
    include_str!("../page/space.js"),
    include_str!("../page/flat.js"),
    include_str!("../page/charts.js"),
    include_str!("../page/source.js"),
    include_str!("../page/legend.js"),
    include_str!("../page/panels.js"),
    include_str!("../page/pointers.js"),
    include_str!("../page/keys.js"),
    include_str!("../page/main.js"),
    "})();\n"
);

/// Facts about the job besides its motion.
#[derive(Clone, Debug, Serialize)]
pub struct Job {
    /// Name of the file.
    pub file: String,
    /// Name of the machine.
    pub profile: String,
    /// Version of the program.
    pub version: String,
    /// Time of the print, s.
    pub print_time_s: f64,
    /// The slicer's estimate, s.
    pub slicer_time_s: Option<f64>,
    /// Net filament.
    pub filament_mm: f64,
    /// Cross-section of the filament.
    pub filament_mm2: f64,
    /// Lines that were read.
    pub lines: u32,
    /// Moves.
    pub moves: u64,
    /// Size of the machine's travel, mm: lower and upper end.
    pub travel_mm: [[f64; 3]; 2],
    /// Greatest flow that the nozzle melts, mm^3/s, if the profile says it.
    pub max_flow_mm3_per_s: Option<f64>,
    /// The nozzle's time constant, s.
    pub nozzle_time_constant_s: f64,
    /// The rules of another firmware that planned the motion; none if this one did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rules: Option<RulesShown>,
    /// Possible gains: words, and the print's time with them, s.
    pub chances: Vec<(String, f64)>,
    /// Remarks, the most important first.
    pub findings: Vec<Finding>,
}

/// Another firmware's rules, and the limits that held by them.
#[derive(Clone, Debug, Serialize)]
pub struct RulesShown {
    /// Name of the rules.
    pub name: &'static str,
    /// Names of the limits, in the order of their numbers ([`crate::Node::limit`]).
    pub limits: Vec<&'static str>,
    /// The limits, the longest time first.
    pub times: Vec<LimitTime>,
}

/// The time of a limit.
#[derive(Clone, Debug, Serialize)]
pub struct LimitTime {
    /// Name of the limit.
    pub limit: &'static str,
    /// Time that it held, s.
    pub seconds: f64,
    /// Moves for most of whose time it held.
    pub moves: u64,
}

/// The page's first data: everything but the columns' bytes.
#[derive(Serialize)]
struct Description<'a> {
    job: &'a Job,
    totals: &'a Totals,
    features: &'a [String],
    columns: Vec<Column>,
    /// Number of nodes that were executed; the others are the rest of a job that stopped.
    executed: usize,
    left_out: u64,
    tolerance_mm: f32,
    text_is_cut: bool,
    has_layers: bool,
}

/// Writes the page.
///
/// # Errors
/// The page cannot be written.
pub fn write_page(out: &mut impl Write, job: &Job, recording: &Recording, text: &Text) -> io::Result<()> {
    let (columns, data) = columns(recording).pack()?;
    let description = Description {
        job,
        totals: &recording.totals,
        features: &text.features,
        columns,
        executed: recording.nodes.iter().filter(|node| !node.is_rest).count(),
        left_out: recording.left_out,
        tolerance_mm: recording.tolerance_mm,
        text_is_cut: text.is_cut,
        has_layers: text.has_layers,
    };
    // Within an element of a page `<` would begin a tag.
    let description = serde_json::to_string(&description)?.replace('<', "\\u003c");
    let lines = packed(&text.kept)?;
    let policy = policy(&[]);
    let title = escaped(&job.file);
    let mut rest = PAGE;
    for (mark, part) in [
        ("{{policy}}", policy.as_str()),
        ("{{title}}", &title),
        ("{{style}}", STYLE),
        ("{{description}}", &description),
        ("{{data}}", &data),
        ("{{lines}}", &lines),
        ("{{script}}", SCRIPT),
    ] {
        let Some((before, after)) = rest.split_once(mark) else {
            return Err(io::Error::other(format!("the page has no place for {mark}")));
        };
        out.write_all(before.as_bytes())?;
        out.write_all(part.as_bytes())?;
        rest = after;
    }
    out.write_all(rest.as_bytes())
}

fn columns(recording: &Recording) -> Columns {
    let nodes = || recording.nodes.iter();
    let heat = || recording.temperatures.iter();
    let mut columns = Columns::default();
    columns.add("time", 1e-4, nodes().map(|node| node.time_s));
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        columns.add(name, 1e-3, nodes().map(|node| node.position_mm[axis].into()));
    }
    columns.add("speed", 0.1, nodes().map(|node| node.speed_mm_per_s.into()));
    columns.add("bead", 1e-4, nodes().map(|node| node.bead.into()));
    columns.add("pressure", 1e-3, nodes().map(|node| node.pressure_mm3.into()));
    columns.add("deviation", 1e-4, nodes().map(|node| node.deviation_mm.into()));
    columns.add("slowed", 1.0, nodes().map(|node| f64::from(u8::from(node.is_slowed))));
    if nodes().any(|node| node.limit > 0) {
        columns.add("limit", 1.0, nodes().map(|node| node.limit.into()));
    }
    columns.add("feed", 0.1, nodes().map(|node| node.feed_mm_per_s.into()));
    columns.add("line", 1.0, nodes().map(|node| node.line.into()));
    columns.add("layer", 1.0, nodes().map(|node| node.layer.into()));
    columns.add("kind", 1.0, nodes().map(|node| f64::from(node.kind as u8)));
    columns.add("tool", 1.0, nodes().map(|node| node.tool.into()));
    columns.add("height", 1e-3, nodes().map(|node| node.height_mm.into()));
    columns.add("width", 1e-3, nodes().map(|node| node.width_mm.into()));
    columns.add("feature", 1.0, nodes().map(|node| node.feature.into()));
    columns.add("heatTime", 0.01, heat().map(|heat| heat.time_s));
    for (heater, [celsius, target]) in [["nozzle", "nozzleTarget"], ["bed", "bedTarget"]].into_iter().enumerate() {
        columns.add(celsius, 0.1, heat().map(|heat| heat.celsius[heater].into()));
        columns.add(target, 0.1, heat().map(|heat| heat.target_celsius[heater].into()));
    }
    if recording.temperatures.iter().all(|heat| heat.chamber.is_some()) {
        let chamber = || heat().filter_map(|heat| heat.chamber);
        columns.add("chamber", 0.1, chamber().map(|chamber| chamber.celsius.into()));
        columns.add("chamberTarget", 0.1, chamber().map(|chamber| chamber.target_celsius.into()));
    }
    columns.add("fan", 1.0, heat().map(|heat| heat.fan_power.into()));
    columns
}

/// The sources of a page's program and styles, as a content security policy names them: a page
/// that shows this one in a frame also has to allow them.
#[derive(Clone, Debug)]
pub struct Sources {
    /// The program's.
    pub script: String,
    /// The styles'.
    pub style: String,
}

impl Sources {
    /// Returns the sources of a program and of styles.
    pub fn of(script: &str, style: &str) -> Self {
        let [script, style] = [script, style].map(|part| format!("'sha256-{}'", base64(&Sha256::digest(part))));
        Self { script, style }
    }

    /// Returns the sources of every page that [`write_page`] writes.
    pub fn of_pages() -> Self {
        Self::of(SCRIPT, STYLE)
    }
}

/// Returns the page's content security policy: it loads and runs only its own parts,
/// and these styles.
pub(crate) fn policy(styles: &[&str]) -> String {
    let Sources { script, style } = Sources::of_pages();
    let styles: String = styles.iter().map(|style| format!(" 'sha256-{}'", base64(&Sha256::digest(style)))).collect();
    format!(
        "default-src 'none'; base-uri 'none'; form-action 'none'; script-src {script}; style-src {style}{styles}; img-src data:"
    )
}

/// Escapes a text for an element.
pub(crate) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}
