//! A round bed: the mesh is a rectangle whose corners the probe cannot reach.

use ferrostep_planner::surface::Mesh;

/// Directions to a point's neighbours along rows and columns; one and two points that way, the
/// surface is extrapolated.
const STRAIGHT: [[i8; 2]; 4] = [[1, 0], [-1, 0], [0, 1], [0, -1]];

/// Directions to a point's diagonal neighbours.
const SLANTED: [[i8; 2]; 4] = [[1, 1], [-1, 1], [1, -1], [-1, -1]];

/// The point at this distance from another; `None` beyond the first row or column.
fn beside([column, row]: [u8; 2], [across, along]: [i8; 2]) -> Option<[u8; 2]> {
    Some([column.checked_add_signed(across)?, row.checked_add_signed(along)?])
}

fn height(mesh: &Mesh, point: [u8; 2], way: [i8; 2]) -> Option<i32> {
    mesh.height_um(beside(point, way)?).map(i32::from)
}

/// Extrapolated height of the surface at a point, um: the mean over the known points beside it,
/// each by a straight line, or by a plane through three; if these give none and `is_level`, the
/// mean of the neighbouring heights.
fn continued_um(mesh: &Mesh, point: [u8; 2], is_level: bool) -> Option<i16> {
    let lines = STRAIGHT.into_iter().filter_map(|[across, along]| {
        Some(2 * height(mesh, point, [across, along])? - height(mesh, point, [2 * across, 2 * along])?)
    });
    let planes = SLANTED.into_iter().filter_map(|[across, along]| {
        let sides = height(mesh, point, [across, 0])? + height(mesh, point, [0, along])?;
        Some(sides - height(mesh, point, [across, along])?)
    });
    let beside = STRAIGHT.into_iter().filter_map(|way| height(mesh, point, way));
    let mean = mean(lines.chain(planes)).or_else(|| if is_level { mean(beside) } else { None })?;
    Some(mean.clamp((i16::MIN + 1).into(), i16::MAX.into()) as i16)
}

fn mean(heights: impl Iterator<Item = i32>) -> Option<i32> {
    let (sum, count) = heights.fold((0_i32, 0_i32), |(sum, count), height| (sum + height, count + 1));
    sum.checked_div(count)
}

/// Gives the unprobed points heights extrapolated from the probed ones: straight, or level where no
/// slope is known. A mesh without any height stays empty.
pub(super) fn continue_surface(mesh: &mut Mesh) {
    let [columns, rows] = mesh.grid().points;
    for is_level in [false, true] {
        // From the middle outwards, at least one ring of points per pass.
        for _ in 0..columns.max(rows) {
            for row in 0..rows {
                for column in 0..columns {
                    let point = [column, row];
                    if mesh.height_um(point).is_none()
                        && let Some(height_um) = continued_um(mesh, point, is_level)
                    {
                        mesh.set_height_um(point, height_um);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use ferrostep_planner::surface::{MeshGrid, MeshInterpolation};
    use proptest::prelude::*;

    /// A grid around 0, 0 whose points within its circle have the heights of a plane, um.
    fn on_a_circle(points: [u8; 2], plane: [f64; 3]) -> (Mesh, impl Fn([u8; 2]) -> f64) {
        let grid = MeshGrid::over([[-1_000_000, 1_000_000]; 2], points).unwrap();
        let height = move |point| {
            let [x, y] = grid.place_10nm(point).map(|units| f64::from(units) / 1e6);
            plane[0] + plane[1] * x + plane[2] * y
        };
        let mut mesh = Mesh::NONE;
        mesh.begin(&grid, MeshInterpolation::Bilinear);
        for row in 0..points[1] {
            for column in 0..points[0] {
                let [x, y] = grid.place_10nm([column, row]).map(i64::from);
                if x * x + y * y <= 1_001_000 * 1_001_000 {
                    mesh.set_height_um([column, row], height([column, row]).round() as i16);
                }
            }
        }
        (mesh, height)
    }

    proptest! {
        /// A plane is extrapolated as that plane, whatever the grid.
        #[test]
        fn a_plane_goes_on(
            points in [3u8..=15, 3u8..=15],
            plane in [-500.0f64..500.0, -400.0..400.0, -400.0..400.0],
        ) {
            // With three rows or columns beside an even number of the others only the middle one
            // is on the circle.
            prop_assume!(!points.contains(&3) || points.iter().all(|count| count % 2 == 1));
            let (mut mesh, height) = on_a_circle(points, plane);
            continue_surface(&mut mesh);
            prop_assert!(mesh.is_complete(), "{points:?}");
            for row in 0..points[1] {
                for column in 0..points[0] {
                    let found = mesh.height_um([column, row]).map(f64::from).unwrap();
                    // Heights are rounded to 1 um, and the extrapolation carries that error on.
                    let away = (found - height([column, row])).abs();
                    prop_assert!(away < 60.0, "{column} {row}: {found}, {away} um away");
                }
            }
        }
    }

    #[test]
    fn corners_of_a_coarse_grid_are_planes() {
        for points in [[3, 3], [4, 4], [5, 5]] {
            let (mut mesh, height) = on_a_circle(points, [10.0, 200.0, -100.0]);
            assert_eq!(mesh.height_um([0, 0]), None);
            continue_surface(&mut mesh);
            let corner = mesh.height_um([0, 0]).map(f64::from).unwrap();
            assert!((corner - height([0, 0])).abs() < 6.0, "{points:?}: {corner}");
        }
    }

    #[test]
    fn of_nothing_nothing_goes_on() {
        let mut mesh = Mesh::NONE;
        continue_surface(&mut mesh);
        mesh.begin(&MeshGrid::over([[0, 1_000_000]; 2], [5, 5]).unwrap(), MeshInterpolation::Bilinear);
        continue_surface(&mut mesh);
        assert!(!mesh.is_complete());
        // A single height is extrapolated level.
        mesh.set_height_um([2, 2], 7);
        continue_surface(&mut mesh);
        assert!((0..25).all(|index| mesh.height_um([index % 5, index / 5]) == Some(7)));
        let (mut mesh, _) = on_a_circle([6, 3], [5.0, 100.0, 300.0]);
        continue_surface(&mut mesh);
        assert_eq!(mesh.height_um([2, 0]), mesh.height_um([2, 1]));
    }
}
