//! Marks that slicers leave in comments: the beginning of a layer, the feature that is printed, the
//! time that they expect.
//!
//! The only place that knows them: counts of layers, waveforms of a layer and pages agree because
//! they all ask here.

use crate::times::{TimeOf, slicer_times};

/// A slicer's mark.
#[derive(Clone, Debug, PartialEq)]
pub enum Mark {
    /// A layer begins.
    Layer,
    /// Name of the feature that is printed from here on.
    Feature(String),
    /// Beads are of this height from here on, mm.
    Height(f32),
    /// Beads are of this width from here on, mm.
    Width(f32),
    /// The slicer's time of the print, s.
    Time(f64),
}

/// Form in which a slicer marks its layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LayerForm {
    /// `;LAYER_CHANGE` (PrusaSlicer and its family).
    LayerChange,
    /// `; CHANGE_LAYER` (Bambu Studio).
    ChangeLayer,
    /// `;LAYER:3` (Cura, ideaMaker), `;LAYER 3`, `; Layer #3` (generators).
    Number,
    /// `;layer:0.30` (FlashPrint).
    Height,
    /// `; layer 1, Z = 0.2` (Simplify3D).
    Simplify,
    /// `; BEGIN_LAYER_OBJECT z=0.2` (KISSlicer).
    Kiss,
}

/// The slicer's times, the one that is compared first: without what comes before the print, where a
/// slicer says both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd)]
enum Compared {
    Everything,
    Model,
}

/// Wider and higher beads are no beads, mm.
const MAX_BEAD_MM: f32 = 100.0;

/// Features that Simplify3D 3 and FlashPrint write by their bare name.
const BARE_FEATURES: [&str; 15] = [
    "outer perimeter",
    "inner perimeter",
    "single extrusion",
    "solid layer",
    "gap fill",
    "infill",
    "bridge",
    "support",
    "dense support",
    "skirt",
    "raft",
    "brim",
    "prime pillar",
    "ooze shield",
    "shell",
];

/// Reads a file's comments in their order.
#[derive(Clone, Debug, Default)]
pub struct Marks {
    /// The form of the file's first layer mark. Marks of another form repeat it.
    form: Option<LayerForm>,
    /// KISSlicer's height, which each object of a layer repeats.
    height: Option<String>,
    /// The source of the time that was returned.
    time_of: Option<Compared>,
}

impl Marks {
    /// Reads a comment, from its `;` on.
    pub fn read(&mut self, comment: &str) -> Option<Mark> {
        let body = comment.trim_start_matches(';').trim();
        if let Some((form, height)) = layer(body) {
            let is_new = *self.form.get_or_insert(form) == form && (height.is_none() || self.height != height);
            self.height = height;
            return is_new.then_some(Mark::Layer);
        }
        if let Some(name) = feature(body) {
            return Some(Mark::Feature(name.to_owned()));
        }
        if let Some(size) = size(body) {
            return Some(size);
        }
        let (of, seconds) = time(comment)?;
        // The first of several counts, and a better one.
        if self.time_of.is_some_and(|before| before >= of) {
            return None;
        }
        self.time_of = Some(of);
        Some(Mark::Time(seconds))
    }
}

/// The form of a layer's mark; the height of a form that repeats it.
fn layer(body: &str) -> Option<(LayerForm, Option<String>)> {
    let is_number = |text: &str| text.trim().parse::<f64>().is_ok_and(f64::is_finite);
    let form = if body.starts_with("LAYER_CHANGE") {
        LayerForm::LayerChange
    } else if body.starts_with("CHANGE_LAYER") {
        LayerForm::ChangeLayer
    } else if ["LAYER:", "LAYER ", "Layer #"].iter().any(|start| body.strip_prefix(start).is_some_and(is_number)) {
        LayerForm::Number
    } else if body.strip_prefix("layer:").is_some_and(is_number) {
        LayerForm::Height
    } else if let Some(rest) = body.strip_prefix("layer ") {
        let (number, height) = rest.split_once(',')?;
        if !(is_number(number) && height.trim_start().starts_with("Z =")) {
            return None;
        }
        LayerForm::Simplify
    } else {
        let rest = body.strip_prefix("BEGIN_LAYER_")?;
        let height = rest.split_ascii_whitespace().find_map(|word| word.strip_prefix("z="));
        return Some((LayerForm::Kiss, Some(height.unwrap_or_default().to_owned())));
    };
    Some((form, None))
}

/// Returns the feature's name: `;TYPE:Perimeter` (PrusaSlicer, Cura, Orca, ideaMaker),
/// `; FEATURE: Outer wall` (Bambu Studio), `; feature outer perimeter` (Simplify3D 4),
/// `; outer perimeter` (Simplify3D 3), `; 'Perimeter Path', 0.6 [feed mm/s]` (KISSlicer),
/// `;shell` (FlashPrint).
fn feature(body: &str) -> Option<&str> {
    let marked = ["TYPE:", "FEATURE:", "feature "].iter().find_map(|start| body.strip_prefix(start));
    let quoted = || Some(body.strip_prefix('\'')?.split_once('\'')?.0.trim_end_matches("Path"));
    let bare = || BARE_FEATURES.contains(&body).then_some(body);
    let name = marked.or_else(quoted).or_else(bare)?.trim();
    (!name.is_empty()).then_some(name)
}

/// Returns the size of the beads: `;HEIGHT:0.2`, `;WIDTH:0.45` (PrusaSlicer and its family),
/// `; LAYER_HEIGHT: 0.2`, `; LINE_WIDTH: 0.42` (Bambu Studio).
fn size(body: &str) -> Option<Mark> {
    const HEIGHTS: [&str; 2] = ["HEIGHT:", "LAYER_HEIGHT:"];
    const WIDTHS: [&str; 2] = ["WIDTH:", "LINE_WIDTH:"];
    let after = |starts: [&str; 2]| starts.iter().find_map(|start| body.strip_prefix(start));
    let (rest, mark): (&str, fn(f32) -> Mark) =
        after(HEIGHTS).map(|rest| (rest, Mark::Height as _)).or_else(|| Some((after(WIDTHS)?, Mark::Width as _)))?;
    let millimetres: f32 = rest.trim().parse().ok()?;
    (millimetres > 0.0 && millimetres < MAX_BEAD_MM).then(|| mark(millimetres))
}

/// A slicer's time that can be compared, s: of the machine's usual mode, and of all of the print.
fn time(comment: &str) -> Option<(Compared, f64)> {
    slicer_times(comment).filter(|time| time.seconds > 0.0).find_map(|time| match time.of {
        TimeOf::Print => Some((Compared::Everything, time.seconds)),
        TimeOf::Model => Some((Compared::Model, time.seconds)),
        TimeOf::SilentPrint | TimeOf::FirstLayer | TimeOf::Elapsed | TimeOf::Remaining => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layers(comments: &[&str]) -> usize {
        let mut marks = Marks::default();
        comments.iter().filter(|comment| marks.read(comment) == Some(Mark::Layer)).count()
    }

    #[test]
    fn layers_of_slicers() {
        for mark in [
            ";LAYER_CHANGE",
            "; CHANGE_LAYER",
            ";LAYER:3",
            ";LAYER 3",
            "; Layer #3",
            ";layer:0.30",
            "; layer 1, Z = 0.20",
        ] {
            assert_eq!(layers(&[mark, ";x", mark]), 2, "{mark}");
        }
        // KISSlicer marks each object of a layer.
        let kiss = |z: &str| format!("; BEGIN_LAYER_OBJECT z={z} z_thickness=0.2");
        assert_eq!(layers(&[&kiss("0.2"), &kiss("0.2"), &kiss("0.4")]), 2);
        // A start code that repeats the mark in another form.
        assert_eq!(layers(&[";LAYER_CHANGE", ";LAYER:0", ";LAYER_CHANGE", ";LAYER:1"]), 2);
        let none = [
            ";LAYERS",
            ";LAYER_COUNT:5",
            "; layer end",
            ";layer:x",
            "; layer 1 of 9",
            ";BEFORE_LAYER_CHANGE",
            ";LAYER:",
            ";LAYER 1 of 9",
        ];
        assert_eq!(layers(&none), 0);
    }

    #[test]
    fn features_of_slicers() {
        for (comment, name) in [
            (";TYPE:WALL-OUTER", Some("WALL-OUTER")),
            ("; FEATURE: Outer wall", Some("Outer wall")),
            (";FEATURE: Outer wall", Some("Outer wall")),
            ("; feature outer perimeter", Some("outer perimeter")),
            ("; outer perimeter", Some("outer perimeter")),
            ("; 'Perimeter Path', 0.6 [feed mm/s], 20.0 [head mm/s]", Some("Perimeter")),
            (";shell", Some("shell")),
            (";TYPE:", None),
            ("; outer perimeter speed 5", None),
        ] {
            assert_eq!(Marks::default().read(comment), name.map(|name| Mark::Feature(name.to_owned())), "{comment}");
        }
    }

    #[test]
    fn sizes_of_beads() {
        for (comment, mark) in [
            (";HEIGHT:0.2", Some(Mark::Height(0.2))),
            (";WIDTH:0.45", Some(Mark::Width(0.45))),
            ("; LAYER_HEIGHT: 0.28", Some(Mark::Height(0.28))),
            ("; LINE_WIDTH: 0.42", Some(Mark::Width(0.42))),
            (";HEIGHT:", None),
            (";WIDTH:nan", None),
            (";HEIGHT:inf", None),
            (";HEIGHT:-nan", None),
            ("; LAYER_HEIGHT: infinity", None),
            (";WIDTH:-1", None),
            (";WIDTH:1e9", None),
        ] {
            assert_eq!(Marks::default().read(comment), mark, "{comment}");
        }
    }

    #[test]
    fn times_of_slicers() {
        for (comment, seconds) in [
            (";TIME:1234.5", Some(1234.5)),
            (";TIME:", None),
            (";TIME:nan", None),
            (";TIME:inf", None),
            ("; estimated printing time (normal mode) = nand nanh infs", None),
            (";TIME_ELAPSED:7", None),
            (";PRINT.TIME:480", Some(480.0)),
            (";Print Time: 2655", Some(2655.0)),
            ("; estimated printing time (normal mode) = 21m 40s", Some(1300.0)),
            ("; estimated printing time (normal mode) = 1d 2h 3m 4s", Some(93_784.0)),
            ("; estimated printing time = 21m 40s", Some(1300.0)),
            ("; estimated printing time (silent mode) = 21m 40s", None),
            ("; estimated first layer printing time (normal mode) = 1m", None),
            ("; estimated printing time (normal mode) = soon", None),
            ("; model printing time: 45s; total estimated time: 6m 50s", Some(45.0)),
            ("; total estimated time: 6m 50s", Some(410.0)),
            (";   Build time: 1 hour 17 minutes", Some(4620.0)),
            (";   Build time: 0 hours 2 minutes", Some(120.0)),
            ("; Estimated Build Time:   113.73 minutes", Some(6823.8)),
        ] {
            match (Marks::default().read(comment), seconds) {
                (Some(Mark::Time(read)), Some(seconds)) => assert!((read - seconds).abs() < 1e-6, "{comment}: {read}"),
                (read, seconds) => assert!(read.is_none() && seconds.is_none(), "{comment}: {read:?}"),
            }
        }
        let mut marks = Marks::default();
        assert_eq!(marks.read("; total estimated time: 6m"), Some(Mark::Time(360.0)));
        assert_eq!(marks.read("; model printing time: 5m"), Some(Mark::Time(300.0)), "a better one");
        assert_eq!(marks.read(";TIME:5"), None, "the first counts");
    }
}
