//! Least-squares fit of a curve with few parameters (Levenberg 1944, Marquardt 1963).

/// Fitted parameters and their uncertainty.
pub struct Fit<const N: usize> {
    /// Values of the parameters.
    pub parameters: [f64; N],
    /// Covariance of the parameters, from the curve's residuals.
    pub covariance: [[f64; N]; N],
}

/// Finds the parameters with the least sum of squared residuals; `None` if there are too few
/// residuals, or one of the parameters has no effect.
pub fn fit<const N: usize>(start: [f64; N], residuals: impl Fn(&[f64; N]) -> Vec<f64>) -> Option<Fit<N>> {
    let mut parameters = start;
    let mut left = residuals(&parameters);
    if left.len() <= N {
        return None;
    }
    let mut damping = 1e-3;
    for _ in 0..200 {
        let (normal, gradient) = normal_equations(&parameters, &left, &residuals);
        let mut damped = normal;
        for (index, row) in damped.iter_mut().enumerate() {
            row[index] *= 1.0 + damping;
        }
        let step = solve(damped, gradient)?;
        let mut next = parameters;
        next.iter_mut().zip(step).for_each(|(parameter, change)| *parameter -= change);
        let next_left = residuals(&next);
        let (sum, next_sum) = (squares(&left), squares(&next_left));
        if next_sum < sum {
            (parameters, left) = (next, next_left);
            damping = f64::max(0.3 * damping, 1e-9);
            if sum - next_sum < 1e-12 * sum {
                break;
            }
        } else {
            damping *= 4.0;
            if damping > 1e12 {
                break;
            }
        }
    }
    let (normal, _) = normal_equations(&parameters, &left, &residuals);
    let variance = squares(&left) / (left.len() - N) as f64;
    let mut covariance = [[0.0; N]; N];
    for column in 0..N {
        let mut unit = [0.0; N];
        unit[column] = variance;
        let solved = solve(normal, unit)?;
        (0..N).for_each(|row| covariance[row][column] = solved[row]);
    }
    parameters.iter().all(|parameter| parameter.is_finite()).then_some(Fit { parameters, covariance })
}

fn squares(residuals: &[f64]) -> f64 {
    residuals.iter().map(|one| one * one).sum()
}

/// Computes J^T J and J^T r by finite differences.
fn normal_equations<const N: usize>(
    parameters: &[f64; N],
    left: &[f64],
    residuals: &impl Fn(&[f64; N]) -> Vec<f64>,
) -> ([[f64; N]; N], [f64; N]) {
    const DIFFERENCE: f64 = 1e-5;
    let columns: [Vec<f64>; N] = std::array::from_fn(|index| {
        let mut moved = *parameters;
        moved[index] += DIFFERENCE;
        residuals(&moved).iter().zip(left).map(|(after, before)| (after - before) / DIFFERENCE).collect()
    });
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let normal = std::array::from_fn(|row| std::array::from_fn(|column| dot(&columns[row], &columns[column])));
    (normal, std::array::from_fn(|row| dot(&columns[row], left)))
}

/// Solves a linear system by Gaussian elimination with partial pivoting; `None` if a column has no
/// pivot.
fn solve<const N: usize>(mut matrix: [[f64; N]; N], mut right: [f64; N]) -> Option<[f64; N]> {
    for column in 0..N {
        let pivot = (column..N).max_by(|a, b| matrix[*a][column].abs().total_cmp(&matrix[*b][column].abs()))?;
        let largest = matrix[pivot][column].abs();
        if largest == 0.0 || largest.is_nan() {
            return None;
        }
        matrix.swap(column, pivot);
        right.swap(column, pivot);
        for row in column + 1..N {
            let factor = matrix[row][column] / matrix[column][column];
            let above = matrix[column];
            matrix[row].iter_mut().zip(above).for_each(|(value, above)| *value -= factor * above);
            right[row] -= factor * right[column];
        }
    }
    let mut solution = [0.0; N];
    for row in (0..N).rev() {
        let known: f64 = (row + 1..N).map(|column| matrix[row][column] * solution[column]).sum();
        solution[row] = (right[row] - known) / matrix[row][row];
    }
    Some(solution)
}
