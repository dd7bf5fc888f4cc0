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

    /// The lines before the cube's first layer, then some moves of its infill again and again, each time with the next of
    /// the choices that M796 has.
    pub fn cube_in_every_way(before: usize, moves: usize) -> Self {
        let cube = Self::cube(320);
        let (start, layer) = cube.lines.split_at(before);
        let is_print = |line: &str| line.starts_with("G1 X") && line.contains(" E");
        let printed: Vec<_> = layer.iter().filter(|(line, _)| is_print(line)).collect();
        // The skirt's first moves turn through a quarter of a circle, the last ones are infill.
        let (curve, infill) = (&printed[..moves / 2], &printed[printed.len() - (moves - moves / 2)..]);
        let mut lines = start.to_vec();
        for acceleration in 0..=2 {
            for interpolation in 0..=4 {
                lines.push((format!("M796 I{interpolation} A{acceleration}"), 0));
                for part in [curve, infill] {
                    // Where the part begins, and its filament from there.
                    let first = &part[0].0;
                    let filament = first.split(" E").nth(1).unwrap_or_default();
                    lines.push((format!("G92 E{filament}"), 0));
                    lines.push((first.split(" E").next().unwrap_or_default().to_owned(), part[0].1));
                    lines.extend(part.iter().map(|&line| line.clone()));
                }
            }
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
