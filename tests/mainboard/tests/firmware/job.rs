//! A real slicer's lines, as a host sends them.

use ferrostep_oracle::gcode_text;

use crate::firmware::images::root;

/// The lines that select each method of M796.
pub const METHODS: [&str; 20] = [
    "M796 I0 A0",
    "M796 I1 A0",
    "M796 I2 A0",
    "M796 I3 A0",
    "M796 I4 A0",
    "M796 I0 A1",
    "M796 I1 A1",
    "M796 I2 A1",
    "M796 I3 A1",
    "M796 I4 A1",
    "M796 I0 A2",
    "M796 I1 A2",
    "M796 I2 A2",
    "M796 I3 A2",
    "M796 I4 A2",
    "M796 I0 A3",
    "M796 I1 A3",
    "M796 I2 A3",
    "M796 I3 A3",
    "M796 I4 A3",
];

/// The text of an example, unpacked.
fn example_text(file: &str) -> String {
    let path = root().join("examples").join(file);
    String::from_utf8(gcode_text(&std::fs::read(path).unwrap()).unwrap()).unwrap()
}

/// True if a line extrudes filament while it moves.
fn is_print(line: &str) -> bool {
    line.starts_with("G1 X") && line.contains(" E") && !line.contains(" E-")
}

/// Lines without comments, each with its number in the file.
#[derive(Clone, Debug)]
pub struct Job {
    /// The file's name in messages.
    file: &'static str,
    lines: Vec<(String, usize)>,
}

impl Job {
    /// The first `count` non-empty lines of the cube: heating, homing, skirt, first
    /// layer, retractions.
    pub fn cube(count: usize) -> Self {
        let mut job = Self::example("cube.gcode");
        job.lines.retain(|(line, _)| !line.is_empty());
        assert!(job.lines.len() >= count, "the example has become shorter");
        job.lines.truncate(count);
        for needed in ["G28", "M109", "M190", "G1 E-", "G1 X"] {
            assert!(job.lines.iter().any(|(line, _)| line.starts_with(needed)), "no {needed} in the lines");
        }
        job
    }

    /// All lines of an example, including empty ones.
    fn example(file: &'static str) -> Self {
        let text = example_text(file);
        let content = |line: &str| line.split(';').next().unwrap_or_default().trim().to_owned();
        Self { file, lines: text.lines().map(content).zip(1..).collect() }
    }

    /// The lines before the cube's first layer, then some moves of its infill again and again, with
    /// each method of M796.
    pub fn cube_with_every_method(before: usize, moves: usize) -> Self {
        let cube = Self::cube(320);
        let (start, layer) = cube.lines.split_at(before);
        let printed: Vec<_> = layer.iter().filter(|(line, _)| is_print(line)).collect();
        // The skirt's first moves turn through a quarter of a circle, the last ones are infill.
        let (curve, infill) = (&printed[..moves / 2], &printed[printed.len() - (moves - moves / 2)..]);
        let mut lines = start.to_vec();
        for method in METHODS {
            lines.push((method.to_owned(), 0));
            for part in [curve, infill] {
                // The start of the part, and its filament from there.
                let first = &part[0].0;
                let filament = first.split(" E").nth(1).unwrap_or_default();
                lines.push((format!("G92 E{filament}"), 0));
                lines.push((first.split(" E").next().unwrap_or_default().to_owned(), part[0].1));
                lines.extend(part.iter().map(|&line| line.clone()));
            }
        }
        Self { lines, ..cube }
    }

    /// The gyroid's modes and homing, then the first moves of the infill of some layers with each
    /// method, given as a line of M796.
    pub fn gyroid_with(methods: &[&str], heights_mm: &[&str], moves: usize) -> Self {
        let gyroid = Self::example("gyroid.gcode.gz");
        let first_move = gyroid.lines.iter().position(|(line, _)| line.starts_with("G1 ")).unwrap();
        let says_something = |(line, _): &&(String, usize)| !line.is_empty();
        let mut lines: Vec<_> = gyroid.lines[..first_move].iter().filter(says_something).cloned().collect();
        let text = example_text(gyroid.file);
        let comments: Vec<&str> = text.lines().collect();
        let place = |from: usize, comment: &str| {
            from + comments[from..].iter().position(|&line| line == comment).unwrap_or_else(|| panic!("no {comment}"))
        };
        for height_mm in heights_mm {
            let layer = place(0, &format!(";Z:{height_mm}"));
            let infill = &gyroid.lines[place(layer, ";TYPE:Internal infill")..];
            let first = infill.iter().position(|(line, _)| is_print(line)).unwrap();
            let is_move = |(_, (line, _)): &(usize, &(String, usize))| is_print(line);
            let (last, _) = infill.iter().enumerate().filter(is_move).nth(moves).unwrap();
            for method in methods {
                lines.push(((*method).to_owned(), 0));
                // The start of the infill, then its speed, its moves, and the moves
                // to the next curve.
                let (start, number) = &infill[first];
                let start = start.split(" E").next().unwrap_or_default();
                lines.push((format!("{start} Z{height_mm} F9000"), *number));
                let stretch = infill[..first].iter().chain(&infill[first + 1..=last]);
                lines.extend(stretch.filter(says_something).cloned());
            }
        }
        Self { lines, ..gyroid }
    }

    /// Replaces heating by M302 P1, for tests without heat that should be fast.
    pub fn without_heating(mut self) -> Self {
        for (line, _) in &mut self.lines {
            if ["M104 ", "M109 ", "M140 ", "M190 "].iter().any(|code| line.starts_with(code)) {
                *line = "M302 P1".to_owned();
            }
        }
        self
    }

    /// Replaces homing by G92 with the place where the mainboard's mechanics are at the start,
    /// for tests that compare all steps: those of homing depend on where the end stops trigger.
    pub fn without_homing(mut self) -> Self {
        for (line, _) in &mut self.lines {
            if line.starts_with("G28") {
                *line = "G92 X82 Y106 Z16".to_owned();
            }
        }
        self
    }

    /// Returns true if a line homes.
    pub fn homes(&self) -> bool {
        self.lines().any(|line| line.starts_with("G28"))
    }

    /// Inserts a line that is not in the file before line `index`.
    pub fn insert(&mut self, index: usize, line: &str) {
        let number = self.lines[index].1;
        self.lines.insert(index, (line.to_owned(), number));
    }

    /// Lines that no slicer wrote.
    pub fn made_up(text: &str) -> Self {
        Self { file: "no file", lines: text.lines().map(str::to_owned).zip(1..).collect() }
    }

    /// The lines.
    pub fn lines(&self) -> impl Iterator<Item = &str> {
        self.lines.iter().map(|(line, _)| line.as_str())
    }

    /// All lines as one text.
    pub fn text(&self) -> String {
        self.lines().map(|line| format!("{line}\n")).collect()
    }

    /// Line `number` of [`Job::text`], with its place in the file.
    pub fn source(&self, number: usize) -> String {
        match number.checked_sub(1).and_then(|index| self.lines.get(index)) {
            Some((line, number)) => format!("line {number} of examples/{}: {line}", self.file),
            None => "homing, or no line at all".to_owned(),
        }
    }
}
