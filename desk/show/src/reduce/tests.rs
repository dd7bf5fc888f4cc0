use super::*;
use crate::node::UNMARKED;

const LAYERS: u32 = 60;
const RING_MM: f32 = 40.0;
const RING_PARTS: u16 = 400;
const LINES: u16 = 400;

/// Path of a layer of [`large_job`]: around the ring, and along the lines of 8 mm, 0.1 mm apart.
fn layer_mm() -> f64 {
    let ring = f64::from(2.0 * RING_MM) * (std::f64::consts::PI / f64::from(RING_PARTS)).sin() * f64::from(RING_PARTS);
    ring + f64::from(LINES) * 8.0_f64.hypot(0.1)
}

/// Layers of a ring and of lines to and fro whose speed rises and falls, in layers
/// that are all alike.
fn large_job(mut push: impl FnMut(Node)) {
    let mut node = Node { layer: UNMARKED, kind: Kind::Travel, ..Node::default() };
    let mut go = |node: &mut Node, position_mm: [f32; 3], speed_mm_per_s: f32, step_s: f64| {
        *node = Node { position_mm, speed_mm_per_s, time_s: node.time_s + step_s, line: node.line + 1, ..*node };
        push(*node);
    };
    for layer in 0..LAYERS {
        let z_mm = 0.2 * (layer + 1) as f32;
        (node.layer, node.kind, node.bead) = (layer, Kind::Travel, 0.0);
        go(&mut node, [100.0 + RING_MM, 100.0, z_mm], 0.0, 0.5);
        (node.kind, node.bead) = (Kind::Print, 0.08);
        for part in 1..=RING_PARTS {
            let angle = std::f32::consts::TAU * f32::from(part) / f32::from(RING_PARTS);
            let place = [100.0 + RING_MM * angle.cos(), 100.0 + RING_MM * angle.sin(), z_mm];
            go(&mut node, place, 30.0 + f32::from(part % 7), 0.02);
        }
        (node.kind, node.bead) = (Kind::Travel, 0.0);
        go(&mut node, [75.0, 96.0, z_mm], 5.0, 1.0);
        (node.kind, node.bead) = (Kind::Print, 0.08);
        for line in 0..LINES {
            let up = if line % 2 == 0 { 1.0 } else { -1.0 };
            let [x, y, _] = node.position_mm;
            let top = 40.0 + 2.0 * f32::from(line % 5);
            go(&mut node, [x + 0.01, y + 0.8 * up, z_mm], top, 0.04);
            go(&mut node, [x + 0.09, y + 7.2 * up, z_mm], top, 0.16);
            go(&mut node, [x + 0.1, y + 8.0 * up, z_mm], 3.0, 0.04);
        }
    }
}

/// Returns the nodes of each layer that print, each with the place that it begins at.
fn printed(nodes: &[Node], layer: u32) -> impl Iterator<Item = (&Node, &Node)> {
    let pairs = nodes.iter().zip(nodes.iter().skip(1));
    pairs.filter(move |(_, node)| node.kind == Kind::Print && node.layer == layer)
}

/// Every layer keeps its path, the first as well as the last.
#[test]
fn every_layer_is_as_near_to_its_path() {
    let mut nodes = Nodes::new(60 * 1000);
    large_job(|node| nodes.push(node));
    let reduced = nodes.finish();
    assert!(reduced.nodes.len() <= 60_000 && reduced.left_out > 30_000, "{}", reduced.nodes.len());
    assert!((0.015..0.09).contains(&reduced.tolerance_mm), "{} mm", reduced.tolerance_mm);
    let mut counts = Vec::new();
    for layer in 0..LAYERS {
        let path_mm: f64 = printed(&reduced.nodes, layer).map(|(from, to)| from.distance_mm(to)).sum();
        assert!((path_mm / layer_mm() - 1.0).abs() < 0.02, "layer {layer}: {path_mm} mm, expected {}", layer_mm());
        for (from, to) in printed(&reduced.nodes, layer).filter(|(_, to)| to.position_mm[0] > 115.5) {
            let middle = [0, 1].map(|axis| 0.5 * (from.position_mm[axis] + to.position_mm[axis]) - 100.0);
            let off = (middle[0].hypot(middle[1]) - RING_MM).abs();
            assert!(off < reduced.tolerance_mm + 0.002, "layer {layer}: the ring is {off} mm off");
        }
        let fastest = |line: &[(&Node, &Node)]| line.iter().map(|(_, to)| to.speed_mm_per_s).fold(0.0, f32::max);
        let lines: Vec<_> = printed(&reduced.nodes, layer)
            .filter(|(_, to)| (74.0..116.0).contains(&to.position_mm[0]) && (to.position_mm[1] - 100.0).abs() < 5.0)
            .collect();
        assert!(lines.chunks(4).all(|chunk| fastest(chunk) > 39.0), "layer {layer} seems slow");
        counts.push(printed(&reduced.nodes, layer).count());
    }
    let (least, most) = (counts.iter().min(), counts.iter().max());
    assert!(most < least.map(|least| 2 * least).as_ref(), "{least:?} to {most:?} places in a layer");
}

/// The fastest printing and the fastest travel are kept, wherever they are.
#[test]
fn extremes_stay() {
    let mut nodes = Nodes::new(20_000);
    let mut number = 0;
    large_job(|node| {
        number += 1;
        nodes.push(Node { speed_mm_per_s: if number == 4711 { 77.0 } else { node.speed_mm_per_s }, ..node });
    });
    let reduced = nodes.finish();
    let fastest = reduced.nodes.iter().map(|node| node.speed_mm_per_s).fold(0.0, f32::max);
    assert_eq!(fastest, 77.0);
    assert_eq!(reduced.nodes.iter().filter(|node| node.speed_mm_per_s == fastest).count(), 1);
}

/// A job without anything that may be joined fits as well, evenly in time.
#[test]
fn any_number_of_retractions_and_layers_fits() {
    let mut nodes = Nodes::new(1000);
    for number in 0..100_000_u32 {
        let kind = if number % 2 == 0 { Kind::Retract } else { Kind::Prime };
        nodes.push(Node { time_s: number.into(), kind, bead: 0.5, layer: number, line: number, ..Node::default() });
    }
    let reduced = nodes.finish();
    assert!((300..=1000).contains(&reduced.nodes.len()), "{}", reduced.nodes.len());
    assert_eq!(reduced.left_out + reduced.nodes.len() as u64, 100_000);
    assert_eq!(reduced.nodes.last().map(|node| node.line), Some(99_999));
    let gaps = || reduced.nodes.windows(2).map(|pair| pair[1].time_s - pair[0].time_s);
    let (least, most) = (gaps().skip(1).fold(f64::MAX, f64::min), gaps().fold(0.0, f64::max));
    assert!(most <= 2.0 * least + 1.0 || most < 300.0, "{least} to {most} s");
}

/// Errors of joins do not add up: the path that is left is within the tolerance of every node.
#[test]
fn no_node_is_farther_than_the_tolerance() {
    let mut nodes = Nodes::new(400);
    let mut all = Vec::new();
    for number in 0..4000_u16 {
        let angle = f32::from(number) * 0.004;
        let radius = 20.0 + angle;
        let position_mm = [radius * angle.cos(), radius * angle.sin(), 0.2];
        let node = Node { position_mm, speed_mm_per_s: 50.0, bead: 0.1, kind: Kind::Print, ..Node::default() };
        all.push(Node { time_s: f64::from(number), ..node });
        nodes.push(Node { time_s: f64::from(number), ..node });
    }
    let reduced = nodes.finish();
    assert!(reduced.nodes.len() <= 400 && reduced.tolerance_mm > 0.0, "{}", reduced.nodes.len());
    let mut parts = reduced.nodes.windows(2).peekable();
    for node in &all {
        while parts.next_if(|pair| pair[1].time_s < node.time_s).is_some() {}
        let Some(&&[from, to]) = parts.peek().map(|pair| <&[Node; 2]>::try_from(*pair)).and_then(Result::ok).as_ref()
        else {
            panic!("the path ends before {node:?}")
        };
        let along: [f32; 3] = std::array::from_fn(|axis| to.position_mm[axis] - from.position_mm[axis]);
        let point: [f32; 3] = std::array::from_fn(|axis| node.position_mm[axis] - from.position_mm[axis]);
        let cross = (along[0] * point[1] - along[1] * point[0]).abs();
        let off = cross / along[0].hypot(along[1]).max(1e-6);
        assert!(off <= reduced.tolerance_mm + 1e-3, "{off} mm at {node:?}");
    }
}
