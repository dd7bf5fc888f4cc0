//! The page's tables, drawn: time over the worst error of a frame that is known to 5 %.

use std::fmt::Write;
use std::path::Path;

use ferrostep_checked_toml::book::REFRESH_VARIABLE;
use ferrostep_svg::{escaped, page};

/// The page, and the part of each file's panel that shows numbers, pixels.
const PAGE: [f64; 2] = [860.0, 570.0];
const INNER: [f64; 2] = [205.0, 190.0];
const FIRST: [f64; 2] = [60.0, 70.0];
const APART: [f64; 2] = [275.0, 270.0];
const PANELS_A_ROW: usize = 3;

/// Files with a panel, by the table's first column.
const FILES: [&str; 5] = ["cube", "gyroid", "Benchy", "arcs", "supports"];

/// Beginnings of the plans' names, colours, and words for the legend.
const PLANS: [(&str, &str, &str); 2] =
    [("Ferrostep", "#0072b2", "Ferrostep"), ("Klipper", "#d55e00", "Klipper's rules")];

/// The row with which the others are compared.
const SHIPPED: (&str, &str) = ("Klipper", "`mzv`");

/// A row of the tables.
#[derive(Clone, Debug, PartialEq)]
struct Row {
    file: String,
    plan: String,
    filter: String,
    time_s: f64,
    /// Error, um: the worst of f, -5 % and +5 %.
    error_um: f64,
}

/// Compares the page's chart with the tables, or draws it.
///
/// # Errors
/// The chart is not that of the tables; the error says how to draw it.
pub fn keep_current(root: &Path) -> Result<(), String> {
    let text =
        std::fs::read_to_string(root.join("tests/data/against-klipper.md")).map_err(|error| error.to_string())?;
    let drawn = draw(&rows(&text));
    let kept = root.join("docs/src/images/against-klipper.svg");
    if std::env::var_os(REFRESH_VARIABLE).is_some() {
        return std::fs::write(kept, drawn).map_err(|error| error.to_string());
    }
    let is_current = std::fs::read_to_string(kept).is_ok_and(|kept| kept == drawn);
    let advice =
        format!("images/against-klipper.svg is not current: run this with {REFRESH_VARIABLE}=1, and look at it");
    if is_current { Ok(()) } else { Err(advice) }
}

/// The rows of a page's tables.
fn rows(page: &str) -> Vec<Row> {
    let row = |line: &str| {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        let [file, plan, filter, time, at_f, below, above, ..] = cells[..] else { return None };
        let errors_um: Vec<f64> = [at_f, below, above].iter().filter_map(|cell| cell.parse().ok()).collect();
        Some(Row {
            file: file.to_owned(),
            plan: plan.to_owned(),
            filter: filter.to_owned(),
            time_s: time.parse().ok()?,
            error_um: errors_um.into_iter().fold(0.0, f64::max),
        })
    };
    page.lines().filter(|line| line.starts_with('|')).filter_map(row).collect()
}

fn draw(rows: &[Row]) -> String {
    let title = "Time, and the error that 99 % of it stays below on a frame known to 5 %";
    let mut content = format!("<text x=\"20\" y=\"30\" font-size=\"15\">{}</text>\n", escaped(title));
    for (index, file) in FILES.iter().enumerate() {
        let place = [index % PANELS_A_ROW, index / PANELS_A_ROW];
        let corner = [0, 1].map(|side: usize| FIRST[side] + APART[side] * place[side] as f64);
        let rows: Vec<&Row> = rows.iter().filter(|row| row.file == *file).collect();
        panel(&mut content, file, corner, &rows);
    }
    legend(&mut content);
    page(title, PAGE, 12, content)
}

fn panel(content: &mut String, file: &str, [left, top]: [f64; 2], rows: &[&Row]) {
    let [width, height] = INNER;
    let range = |value: fn(&Row) -> f64| {
        let values = || rows.iter().map(|row| value(row));
        [values().fold(f64::MAX, f64::min), values().fold(0.0, f64::max)]
    };
    let [fastest_s, slowest_s] = range(|row| row.time_s);
    let [_, worst_um] = range(|row| row.error_um);
    let margin_s = 0.07 * (slowest_s - fastest_s);
    let across =
        |time_s: f64| left + width * (time_s - fastest_s + margin_s) / (slowest_s - fastest_s + 2.0 * margin_s);
    let up = |error_um: f64| top + height * (1.0 - error_um / (1.1 * worst_um));
    let is_shipped = |row: &&&Row| (row.plan.as_str(), row.filter.as_str()) == SHIPPED;
    if let Some(shipped) = rows.iter().find(is_shipped) {
        let (x, y) = (across(shipped.time_s), up(shipped.error_um));
        let _ = writeln!(
            content,
            "<rect x=\"{left:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"#009e73\" fill-opacity=\"0.13\"/>",
            x - left,
            top + height - y
        );
    }
    let _ = writeln!(
        content,
        "<rect x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" fill=\"none\" stroke=\"#8c959f\"/>\n\
         <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" font-weight=\"bold\">{file}</text>",
        left + 0.5 * width,
        top - 8.0
    );
    for time_s in ticks(fastest_s, slowest_s) {
        let x = across(time_s);
        let bottom = top + height;
        let _ = writeln!(
            content,
            "<path d=\"M{x:.1} {bottom:.1}v5\" stroke=\"#8c959f\"/>\
             <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{time_s}</text>",
            bottom + 18.0
        );
    }
    for error_um in ticks(0.0, worst_um) {
        let y = up(error_um);
        let _ = writeln!(
            content,
            "<path d=\"M{left:.1} {y:.1}h-5\" stroke=\"#8c959f\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{error_um}</text>",
            left - 8.0,
            y + 4.0
        );
    }
    for (start, colour, _) in PLANS {
        for filter in ["`zv`", "`mzv`"] {
            let mut line: Vec<_> =
                rows.iter().filter(|row| row.plan.starts_with(start) && row.filter == filter).copied().collect();
            line.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
            let mut path = String::new();
            for row in line {
                let (x, y) = (across(row.time_s), up(row.error_um));
                let _ = write!(path, "{}{x:.1} {y:.1}", if path.is_empty() { 'M' } else { 'L' });
                let _ = writeln!(
                    content,
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4.5\" {}><title>{}, {}: {} s, {} µm</title></circle>",
                    mark(filter, colour),
                    escaped(&row.plan),
                    filter.trim_matches('`'),
                    row.time_s,
                    row.error_um
                );
            }
            let _ = writeln!(content, "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-opacity=\"0.5\"/>");
        }
    }
}

/// Attributes that draw a filter's point.
fn mark(filter: &str, colour: &str) -> String {
    let fill = if filter == "`zv`" { colour } else { "#ffffff" };
    format!("fill=\"{fill}\" stroke=\"{colour}\" stroke-width=\"1.5\"")
}

fn legend(content: &mut String) {
    let [left, top] = [FIRST[0] + 2.0 * APART[0], FIRST[1] + APART[1] + 15.0];
    let mut line = 0.0;
    for (_, colour, name) in PLANS {
        for filter in ["`zv`", "`mzv`"] {
            let y = top + 24.0 * line;
            let _ = writeln!(
                content,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"4.5\" {}/><text x=\"{:.1}\" y=\"{y:.1}\">{name}, {}</text>",
                left + 6.0,
                y - 4.0,
                mark(filter, colour),
                left + 20.0,
                filter.trim_matches('`')
            );
            line += 1.0;
        }
    }
    let y = top + 24.0 * line;
    let _ = writeln!(
        content,
        "<rect x=\"{left:.1}\" y=\"{:.1}\" width=\"13\" height=\"13\" fill=\"#009e73\" fill-opacity=\"0.13\" stroke=\"#8c959f\"/>\
         <text x=\"{:.1}\" y=\"{y:.1}\">faster and no less accurate</text>\
         <text x=\"{:.1}\" y=\"{:.1}\">than Klipper with MZV</text>\n\
         <text x=\"{left:.1}\" y=\"{:.1}\">across: time, s</text><text x=\"{left:.1}\" y=\"{:.1}\">up: error, µm</text>",
        y - 11.0,
        left + 20.0,
        left + 20.0,
        y + 18.0,
        y + 50.0,
        y + 70.0
    );
}

/// Round numbers from one to another.
fn ticks(low: f64, high: f64) -> Vec<f64> {
    let span = high - low;
    let power = 10f64.powf((span / 3.0).log10().floor());
    let step =
        [1.0, 2.0, 5.0, 10.0].map(|part| part * power).into_iter().find(|step| span / step <= 4.0).unwrap_or(span);
    let first = (low / step).ceil() as i32;
    (first..).map(|count| f64::from(count) * step).take_while(|tick| *tick <= high).collect()
}
