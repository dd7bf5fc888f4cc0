//! Places of rooms and arrows: each package below all that use it, in rows, with few crossings.
//!
//! As in K. Sugiyama's layered drawings: an arrow that passes rows has a place in each of them; a
//! row's order follows the means of its neighbours in the row above or below.

use std::collections::BTreeSet;

/// Width of the drawing, pixels: a column of the book.
pub const WIDTH: f64 = 750.0;

/// Width and height of a room, pixels.
pub const ROOM: [f64; 2] = [132.0, 36.0];

/// Maximum number of rooms in a row.
const MAX_ROOMS: usize = 4;

/// Maximum number of rooms in a row that no arrow passes.
const MAX_ROOMS_WITHOUT_ARROWS: usize = 5;

/// Width that a passing arrow takes, pixels.
const PASSAGE: f64 = 8.0;

/// Distance between neighbours, pixels.
const GAP: f64 = 6.0;

/// Height from one row to the next, pixels.
const ROW: f64 = 82.0;

/// Distance from the drawing's edges, pixels.
const EDGE: f64 = 12.0;

/// Passes over all rows, for their order and then for their places.
const PASSES: usize = 60;

/// A room, or an arrow that passes a row.
#[derive(Clone, Copy, Debug)]
struct Place {
    row: usize,
    is_room: bool,
    x: f64,
}

/// The drawing.
#[derive(Debug)]
pub struct Layout {
    /// The rooms first, in the packages' order.
    places: Vec<Place>,
    rooms: usize,
    /// Places by row, from the left.
    rows: Vec<Vec<usize>>,
    /// Neighbours in the rows above and below.
    links: Vec<[usize; 2]>,
    /// Places of each arrow, from the top.
    arrows: Vec<Vec<usize>>,
}

impl Layout {
    /// Lays out packages. `uses`: the arrows of each, which have no cycle. `is_last`: true for
    /// those in the last rows, which have no arrows.
    pub fn new(uses: &[BTreeSet<usize>], is_last: &[bool]) -> Self {
        let mut row_of = rows(uses, is_last);
        let last = row_of.iter().max().map_or(0, |last| last + 1);
        let last_rooms = row_of.iter_mut().zip(is_last).filter(|(_, is_last)| **is_last).map(|(row, _)| row);
        last_rooms.enumerate().for_each(|(number, row)| *row = last + number / MAX_ROOMS_WITHOUT_ARROWS);
        let mut layout = Self {
            places: row_of.iter().map(|row| Place { row: *row, is_room: true, x: 0.0 }).collect(),
            rooms: uses.len(),
            rows: vec![Vec::new(); row_of.iter().max().map_or(0, |last| last + 1)],
            links: Vec::new(),
            arrows: Vec::new(),
        };
        for (user, used) in uses.iter().enumerate() {
            for used in used {
                layout.add_arrow(user, *used);
            }
        }
        for (index, place) in layout.places.iter().enumerate() {
            layout.rows[place.row].push(index);
        }
        layout.order();
        layout.place();
        layout
    }

    fn add_arrow(&mut self, user: usize, used: usize) {
        let mut passed = vec![user];
        for row in self.places[user].row + 1..self.places[used].row {
            passed.push(self.places.len());
            self.places.push(Place { row, is_room: false, x: 0.0 });
        }
        passed.push(used);
        self.links.extend(passed.windows(2).map(|pair| [pair[0], pair[1]]));
        self.arrows.push(passed);
    }

    /// Orders each row by its neighbours, downwards and upwards in turn, and keeps the order with
    /// the fewest crossings.
    fn order(&mut self) {
        let mut best = (self.crossings(), self.rows.clone());
        for pass in 0..PASSES {
            let count = self.rows.len();
            for step in 1..count {
                let (row, is_above) = if pass % 2 == 0 { (step, true) } else { (count - 1 - step, false) };
                let at = self.positions();
                let mean = |place: &usize| {
                    let near = self.neighbours(*place, is_above).map(|near| at[near]);
                    mean(near).unwrap_or(at[*place])
                };
                let mut ordered: Vec<(f64, usize)> = self.rows[row].iter().map(|place| (mean(place), *place)).collect();
                ordered.sort_by(|a, b| a.0.total_cmp(&b.0));
                self.rows[row] = ordered.into_iter().map(|(_, place)| place).collect();
            }
            let crossings = self.crossings();
            if crossings < best.0 {
                best = (crossings, self.rows.clone());
            }
        }
        self.rows = best.1;
    }

    /// Each place's part of its row, 0 to 1.
    fn positions(&self) -> Vec<f64> {
        let mut at = vec![0.0; self.places.len()];
        for row in &self.rows {
            for (index, place) in row.iter().enumerate() {
                at[*place] = (index as f64 + 0.5) / row.len() as f64;
            }
        }
        at
    }

    fn neighbours(&self, place: usize, is_above: bool) -> impl Iterator<Item = usize> + '_ {
        let (own, other) = if is_above { (1, 0) } else { (0, 1) };
        self.links.iter().filter(move |link| link[own] == place).map(move |link| link[other])
    }

    fn crossings(&self) -> usize {
        let at = self.positions();
        let crosses = |a: &[usize; 2], b: &[usize; 2]| {
            self.places[a[0]].row == self.places[b[0]].row && (at[a[0]] - at[b[0]]) * (at[a[1]] - at[b[1]]) < 0.0
        };
        self.links
            .iter()
            .enumerate()
            .map(|(index, a)| self.links[..index].iter().filter(|b| crosses(a, b)).count())
            .sum()
    }

    /// Places of each row near their neighbours, without overlaps.
    fn place(&mut self) {
        for row in 0..self.rows.len() {
            let positions = self.positions();
            let wanted = self.rows[row].iter().map(|place| positions[*place] * WIDTH).collect::<Vec<_>>();
            self.settle(row, &wanted);
        }
        for _ in 0..PASSES {
            for row in (0..self.rows.len()).chain((0..self.rows.len()).rev()) {
                let wanted: Vec<f64> = self.rows[row]
                    .iter()
                    .map(|place| {
                        let near = [true, false].into_iter().flat_map(|above| self.neighbours(*place, above));
                        let x = self.places[*place].x;
                        mean(near.map(|near| self.places[near].x)).map_or(x, |near| 0.5 * (near + x))
                    })
                    .collect();
                self.settle(row, &wanted);
            }
        }
    }

    /// Puts a row's places where they are wanted, as far as order and distances allow.
    fn settle(&mut self, row: usize, wanted: &[f64]) {
        let row = &self.rows[row];
        let half = |place: usize| if self.places[place].is_room { ROOM[0] / 2.0 } else { PASSAGE / 2.0 };
        let distance = |a: usize, b: usize| half(a) + GAP + half(b);
        // The leftmost and the rightmost arrangement that keep the distances; between them all lie
        // within the drawing.
        let mut least: Vec<f64> = wanted.to_vec();
        let mut low = EDGE - GAP;
        for (index, place) in row.iter().enumerate() {
            let min = if index == 0 { EDGE + half(*place) } else { low + distance(row[index - 1], *place) };
            least[index] = least[index].max(min);
            low = least[index];
        }
        let mut most: Vec<f64> = wanted.to_vec();
        let mut high = WIDTH;
        for (index, place) in row.iter().enumerate().rev() {
            let max = row.get(index + 1).map_or(WIDTH - EDGE - half(*place), |next| high - distance(*place, *next));
            most[index] = most[index].min(max);
            high = most[index];
        }
        let mut x: Vec<f64> = least.iter().zip(&most).map(|(least, most)| 0.5 * (least + most)).collect();
        // The mean of both keeps the distances, but may lie beyond an edge that only one
        // of them has met.
        for index in (0..row.len()).rev() {
            let max = row
                .get(index + 1)
                .map_or(WIDTH - EDGE - half(row[index]), |next| x[index + 1] - distance(row[index], *next));
            x[index] = x[index].min(max);
        }
        for index in 0..row.len() {
            let min =
                if index == 0 { EDGE + half(row[0]) } else { x[index - 1] + distance(row[index - 1], row[index]) };
            x[index] = x[index].max(min);
        }
        for (place, x) in row.clone().into_iter().zip(x) {
            self.places[place].x = x;
        }
    }

    /// Height of the drawing, pixels.
    pub fn height(&self) -> f64 {
        self.rows.len().saturating_sub(1) as f64 * ROW + ROOM[1] + 2.0 * EDGE
    }

    fn top(&self, place: usize) -> f64 {
        EDGE + self.places[place].row as f64 * ROW
    }

    /// Middle of each room's upper edge, in the packages' order.
    pub fn rooms(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        (0..self.rooms).map(|room| [self.places[room].x, self.top(room)])
    }

    /// Points of each arrow, from the lower edge of a room to the upper edge of another.
    pub fn arrows(&self) -> impl Iterator<Item = Vec<[f64; 2]>> + '_ {
        self.arrows.iter().map(|places| {
            let ends = places.iter().enumerate().flat_map(|(index, place)| {
                let (x, top) = (self.places[*place].x, self.top(*place));
                let above = (index > 0).then_some([x, top]);
                let below = (index + 1 < places.len()).then_some([x, top + ROOM[1]]);
                above.into_iter().chain(below)
            });
            ends.collect()
        })
    }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

/// The row of each package: below all that use it, with at most [`MAX_ROOMS`] in each, without
/// those of the last row.
fn rows(uses: &[BTreeSet<usize>], is_last: &[bool]) -> Vec<usize> {
    // Number of rows that a package needs below it: the deepest are placed first.
    fn depth(uses: &[BTreeSet<usize>], package: usize, known: &mut [Option<usize>]) -> usize {
        if let Some(depth) = known[package] {
            return depth;
        }
        let depth = uses[package].iter().map(|used| 1 + depth(uses, *used, known)).max().unwrap_or(0);
        known[package] = Some(depth);
        depth
    }
    let mut known = vec![None; uses.len()];
    let depths: Vec<usize> = (0..uses.len()).map(|package| depth(uses, package, &mut known)).collect();
    let mut order: Vec<usize> = (0..uses.len()).collect();
    order.sort_by_key(|package| (std::cmp::Reverse(depths[*package]), *package));
    let (mut row_of, mut filled) = (vec![0; uses.len()], Vec::<usize>::new());
    // Users are deeper than what they use, so they are placed before it.
    for package in order.into_iter().filter(|package| !is_last[*package]) {
        let users = (0..uses.len()).filter(|user| uses[*user].contains(&package));
        let mut row = users.map(|user| row_of[user] + 1).max().unwrap_or(0);
        while filled.get(row).is_some_and(|rooms| *rooms >= MAX_ROOMS) {
            row += 1;
        }
        if filled.len() <= row {
            filled.resize(row + 1, 0);
        }
        filled[row] += 1;
        row_of[package] = row;
    }
    row_of
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chain() -> Vec<BTreeSet<usize>> {
        // 0 uses 1 and 4; 1 uses 2; 2 uses 3; 4 to 9 use nothing.
        let mut uses = vec![BTreeSet::new(); 10];
        uses[0].extend([1, 4, 5, 6, 7, 8, 9]);
        uses[1].insert(2);
        uses[2].insert(3);
        uses
    }

    #[test]
    fn a_package_stands_below_its_users_in_rows_of_few() {
        let uses = chain();
        let row_of = rows(&uses, &[false; 10]);
        for (user, used) in uses.iter().enumerate() {
            assert!(used.iter().all(|used| row_of[*used] > row_of[user]), "{row_of:?}");
        }
        for row in 0..5 {
            assert!(row_of.iter().filter(|other| **other == row).count() <= MAX_ROOMS, "{row_of:?}");
        }
    }

    #[test]
    fn rooms_and_passages_keep_their_distance() {
        let layout = Layout::new(&chain(), &[false; 10]);
        for row in &layout.rows {
            for pair in row.windows(2) {
                let half = |place: usize| if layout.places[place].is_room { ROOM[0] / 2.0 } else { PASSAGE / 2.0 };
                let apart = layout.places[pair[1]].x - layout.places[pair[0]].x;
                assert!(apart >= half(pair[0]) + half(pair[1]) + GAP - 1e-6, "{layout:?}");
            }
        }
        let within = ROOM[0] / 2.0..=WIDTH - ROOM[0] / 2.0;
        assert!(layout.rooms().all(|[x, _]| within.contains(&x)), "{layout:?}");
    }
}
