//! A real slicer's lines, as a host sends them.

use std::path::Path;

/// Lines without comments, each with its number in the file.
#[derive(Clone, Debug)]
pub struct Job {
    lines: Vec<(String, usize)>,
}

impl Job {
    /// The first `count` lines of the cube that say something: heating, homing, skirt, first layer, retractions.
    pub fn cube(count: usize) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/cube.gcode");
        let text = std::fs::read_to_string(path).unwrap();
        let content = |line: &str| line.split(';').next().unwrap_or_default().trim().to_owned();
        let lines: Vec<_> = text
            .lines()
            .enumerate()
            .map(|(index, line)| (content(line), index + 1))
            .filter(|(line, _)| !line.is_empty())
            .take(count)
            .collect();
        assert_eq!(lines.len(), count, "the example has become shorter");
        for needed in ["G28", "M109", "M190", "G1 E-", "G1 X"] {
            assert!(lines.iter().any(|(line, _)| line.starts_with(needed)), "no {needed} in the lines");
        }
        Self { lines }
    }

    /// Prints cold instead of waiting for heat: for what has nothing to do with it, and is not to take so long.
    pub fn without_heating(mut self) -> Self {
        for (line, _) in &mut self.lines {
            if ["M104 ", "M109 ", "M140 ", "M190 "].iter().any(|code| line.starts_with(code)) {
                *line = "M302 P1".to_owned();
            }
        }
        self
    }

    /// Puts a line that is not in the file before line `index`.
    pub fn insert(&mut self, index: usize, line: &str) {
        let number = self.lines[index].1;
        self.lines.insert(index, (line.to_owned(), number));
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
            Some((line, number)) => format!("line {number} of examples/cube.gcode: {line}"),
            None => "homing, or no line at all".to_owned(),
        }
    }
}
