//! A page with two prints beside each other: a table, and below it the page of each.

use std::io::{self, Write};

use crate::page::{escaped, policy};

const STYLE: &str = include_str!("../page/comparison.css");

/// A line of the table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Row {
    /// Name of the compared figure.
    pub name: String,
    /// The values of both prints, with their units.
    pub values: [String; 2],
    /// Change from the first print to the second; empty where that means nothing.
    pub change: String,
}

/// Writes the page. `names` are those of the prints, `pages` their pages by [`crate::write_page`].
///
/// # Errors
/// The page cannot be written.
pub fn write_comparison(
    out: &mut impl Write,
    title: &str,
    names: [String; 2],
    rows: &[Row],
    pages: [&str; 2],
) -> io::Result<()> {
    let [first, second] = names.each_ref().map(|name| escaped(name));
    // A page within a page obeys both policies.
    write!(
        out,
        "<!doctype html><!-- ferrostep show -->\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>{}: compared</title>\n\
         <link rel=\"icon\" href=\"data:,\">\n<style>{STYLE}</style>\n</head>\n<body>\n<table>\n\
         <thead><tr><th></th><th>A: {first}</th><th>B: {second}</th><th>B beside A</th></tr></thead>\n<tbody>\n",
        policy(&[STYLE]),
        escaped(title)
    )?;
    for Row { name, values: [a, b], change } in rows {
        let [name, a, b, change] = [name, a, b, change].map(|text| escaped(text));
        writeln!(out, "<tr><th>{name}</th><td>{a}</td><td>{b}</td><td>{change}</td></tr>")?;
    }
    writeln!(out, "</tbody>\n</table>\n<main>")?;
    for (name, page) in [first, second].iter().zip(pages) {
        let page = escaped(page).replace('"', "&quot;");
        writeln!(out, "<iframe title=\"{}\" srcdoc=\"{page}\"></iframe>", name.replace('"', "&quot;"))?;
    }
    writeln!(out, "</main>\n</body>\n</html>")
}
