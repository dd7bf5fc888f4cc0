//! The longest way through a graph whose nodes have costs.

/// Nodes by their number: the cost of each, and the nodes that follow it.
#[derive(Debug, Default)]
pub struct Graph {
    costs: Vec<u32>,
    next: Vec<Vec<usize>>,
}

/// The longest way to one of the ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Longest {
    /// The sum of its costs, every node of a loop once.
    pub cost: u32,
    /// True if a loop is on a path to an end.
    pub has_loop: bool,
}

impl Graph {
    /// Adds a node and returns its number.
    pub fn add(&mut self, cost: u32) -> usize {
        self.costs.push(cost);
        self.next.push(Vec::new());
        self.costs.len() - 1
    }

    /// Sets the cost of a node.
    pub fn set_cost(&mut self, node: usize, cost: u32) {
        self.costs[node] = cost;
    }

    /// Makes a node follow another.
    pub fn connect(&mut self, from: usize, to: usize) {
        self.next[from].push(to);
    }

    /// Returns true for each node that leads to one of the ends.
    pub fn leading_to(&self, ends: &[usize]) -> Vec<bool> {
        let mut before = vec![Vec::new(); self.next.len()];
        for (from, next) in self.next.iter().enumerate() {
            next.iter().for_each(|&to| before[to].push(from));
        }
        let mut leads = vec![false; self.next.len()];
        let mut pending = ends.to_vec();
        while let Some(node) = pending.pop() {
            if !std::mem::replace(&mut leads[node], true) {
                pending.extend(&before[node]);
            }
        }
        leads
    }

    /// The longest path from node 0 to one of the ends; `None` if no path leads there.
    pub fn longest(&self, ends: &[usize]) -> Option<Longest> {
        let leads = self.leading_to(ends);
        leads.first().filter(|leads| **leads)?;
        let groups = self.groups(&leads);
        let mut group_of = vec![0; self.next.len()];
        for (number, group) in groups.iter().enumerate() {
            group.iter().for_each(|&node| group_of[node] = number);
        }
        // The groups are sorted: those that follow a group come before it.
        let mut most = vec![0; groups.len()];
        let mut has_loop = false;
        for (number, group) in groups.iter().enumerate() {
            let own: u32 = group.iter().map(|&node| self.costs[node]).sum();
            let next = group.iter().flat_map(|&node| &self.next[node]).filter(|&&to| leads[to]);
            let after = next.clone().map(|&to| group_of[to]).filter(|&to| to != number).map(|to| most[to]).max();
            has_loop |= next.clone().any(|&to| group_of[to] == number);
            most[number] = own + after.unwrap_or_default();
        }
        Some(Longest { cost: most[group_of[0]], has_loop })
    }

    /// The strongly connected components among the nodes that count, by Tarjan's algorithm,
    /// without recursion.
    fn groups(&self, counts: &[bool]) -> Vec<Vec<usize>> {
        const UNSEEN: usize = usize::MAX;
        let nodes = self.next.len();
        let (mut index, mut low, mut on_stack) = (vec![UNSEEN; nodes], vec![0; nodes], vec![false; nodes]);
        let (mut groups, mut stack, mut seen) = (Vec::new(), Vec::new(), 0);
        let mut calls = vec![(0, 0)];
        while let Some((node, place)) = calls.pop() {
            if place == 0 {
                (index[node], low[node]) = (seen, seen);
                seen += 1;
                stack.push(node);
                on_stack[node] = true;
            }
            let mut descends = false;
            for (place, &to) in self.next[node].iter().enumerate().skip(place) {
                if !counts[to] {
                    continue;
                }
                if index[to] == UNSEEN {
                    // After it, this one is looked at again.
                    calls.extend([(node, place + 1), (to, 0)]);
                    descends = true;
                    break;
                }
                if on_stack[to] {
                    low[node] = low[node].min(index[to]);
                }
            }
            if descends {
                continue;
            }
            if low[node] == index[node] {
                let start = stack.iter().rposition(|&other| other == node).unwrap_or_default();
                let group = stack.split_off(start);
                group.iter().for_each(|&node| on_stack[node] = false);
                groups.push(group);
            }
            if let Some((caller, _)) = calls.last() {
                low[*caller] = low[*caller].min(low[node]);
            }
        }
        groups
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn graph(costs: &[u32], edges: &[(usize, usize)]) -> Graph {
        let mut graph = Graph::default();
        for &cost in costs {
            graph.add(cost);
        }
        edges.iter().for_each(|&(from, to)| graph.connect(from, to));
        graph
    }

    #[test]
    fn the_longest_way_is_found() {
        let ways = graph(&[1, 10, 100, 1000, 5], &[(0, 1), (0, 2), (1, 4), (2, 4), (0, 3)]);
        // 3 leads to no end.
        assert_eq!(ways.longest(&[4]), Some(Longest { cost: 106, has_loop: false }));
        assert_eq!(ways.longest(&[3]), Some(Longest { cost: 1001, has_loop: false }));
        assert_eq!(graph(&[1, 1], &[]).longest(&[1]), None);
    }

    #[test]
    fn a_loop_counts_once_and_is_told() {
        let ways = graph(&[1, 10, 100, 1000, 5], &[(0, 1), (1, 2), (2, 3), (3, 1), (2, 4)]);
        assert_eq!(ways.longest(&[4]), Some(Longest { cost: 1116, has_loop: true }));
        let itself = graph(&[1, 2, 4], &[(0, 1), (1, 1), (1, 2)]);
        assert_eq!(itself.longest(&[2]), Some(Longest { cost: 7, has_loop: true }));
        // A loop that leads to no end is not on a path.
        let beside = graph(&[1, 2, 4], &[(0, 1), (1, 1), (0, 2)]);
        assert_eq!(beside.longest(&[2]), Some(Longest { cost: 5, has_loop: false }));
    }
}
