//! `ferrostep papers`.

use std::path::Path;
use std::process::ExitCode;

use ferrostep_analysis::method_comparison;
use ferrostep_host::printable;
use ferrostep_papers::tables::{Chapter, Paper};
use ferrostep_session::input;

use crate::outcome::result;
use crate::progress;
use crate::terminal::tell;

/// Computes the papers' tables, and draws their figures into a folder.
pub fn run(paper: Option<Paper>, json: bool, folder: Option<&Path>) -> Result<ExitCode, String> {
    let papers = paper.map_or_else(|| Paper::ALL.to_vec(), |paper| vec![paper]);
    let chapters: Vec<_> = papers.into_iter().map(Paper::chapter).collect();
    if let Some(folder) = folder {
        for chapter in &chapters {
            for path in chapter.draw(folder).map_err(|error| error.to_string())? {
                tell(printable::name(&path));
            }
        }
    }
    Ok(result(json.then(|| serde_json::json!({ "papers": chapters })), || {
        chapters.iter().map(Chapter::text).collect::<Vec<_>>().join("\n")
    }))
}

/// `papers --compare`: prints a file with every combination of methods.
pub fn compare(file: &Path, profile: &str, json: bool) -> Result<ExitCode, String> {
    let profile = ferrostep_profiles::load(profile).map_err(|error| error.to_string())?;
    let bar = progress::bar(method_comparison::ways().count() as u64, "{bar:20} {pos}/{len} {wide_msg}");
    let table = method_comparison::compare(file, &profile, |interpolation, acceleration| {
        bar.set_message(format!("{}, {}", interpolation.name(), acceleration.name()));
        bar.inc(1);
    });
    bar.finish_and_clear();
    let table = table.map_err(|error| format!("{}: {error}", input::name(file)))?;
    Ok(result(json.then(|| serde_json::json!({ "choices": table })), || table.text()))
}
