//! Keys by their paths, as errors name them.

use toml::{Table, Value};

/// Paths of all keys of a table, those of tables within it included: `nozzle`,
/// `nozzle.pid`, `nozzle.pid.p`.
pub fn paths(table: &Table) -> Vec<String> {
    let mut paths = Vec::new();
    for (key, value) in table {
        paths.push(key.clone());
        if let Value::Table(inner) = value {
            paths.extend(self::paths(inner).into_iter().map(|path| format!("{key}.{path}")));
        }
    }
    paths
}

/// The table that holds a key, and the last part of the key's path; `None` if the path does not
/// lead through tables.
pub fn holder<'a, 'b>(root: &'a mut Table, path: &'b str) -> Option<(&'a mut Table, &'b str)> {
    match path.split_once('.') {
        None => Some((root, path)),
        Some((first, rest)) => holder(root.get_mut(first)?.as_table_mut()?, rest),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_key_has_a_path_and_a_holder() {
        let mut table: Table = "a = 1\n[b]\nc = 2\n[b.d]\ne = 3\n".parse().unwrap();
        assert_eq!(paths(&table), ["a", "b", "b.c", "b.d", "b.d.e"]);
        let (inner, last) = holder(&mut table, "b.d.e").unwrap();
        assert_eq!((inner.len(), inner.remove(last)), (1, Some(Value::Integer(3))));
        assert!(holder(&mut table, "b.x.e").is_none() && holder(&mut table, "a.e").is_none());
    }
}
