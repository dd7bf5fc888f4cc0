//! Recipes by which package managers install a release: Homebrew's formula and the AUR's PKGBUILD,
//! from the templates in `desk/packaging/`.

use std::fs;
use std::path::Path;

use super::{Failure, digest_of, read, write_file};
use crate::system;

/// The templates.
const TEMPLATES: &str = "desk/packaging";

/// Names of the recipes, each with that of its template.
const RECIPES: [(&str, &str); 2] = [("ferrostep.rb", "ferrostep.rb.in"), ("PKGBUILD", "PKGBUILD.in")];

/// Mark before a value's name in a template; the same mark ends it.
const MARK: char = '@';

/// Writes the recipes for the archives in a release's folder. `repository`: the public address.
///
/// # Errors
/// An archive that a recipe names is missing, or a template asks for an unknown value.
pub fn write(folder: &Path, version: &str, repository: &str) -> Result<(), Failure> {
    for (name, template) in RECIPES {
        let template = Path::new(TEMPLATES).join(template);
        let text = read(&system::root().join(&template))?;
        let value = |key: &str| match key {
            "version" => Ok(version.to_owned()),
            "repository" => Ok(repository.trim_end_matches('/').to_owned()),
            key => match key.strip_prefix("sha256:") {
                Some(triple) => digest_of(&folder.join(archive(version, triple))),
                None => Err(format!("unknown value {MARK}{key}{MARK}")),
            },
        };
        let recipe = filled(&text, value).map_err(|error| format!("{}: {error}", template.display()))?;
        let to = folder.join("recipes");
        fs::create_dir_all(&to).map_err(|error| format!("{}: {error}", to.display()))?;
        write_file(&to.join(name), &recipe)?;
    }
    Ok(())
}

/// Name of a system's archive; the templates and `[package.metadata.binstall]` of the
/// command also name it.
pub fn archive(version: &str, triple: &str) -> String {
    format!("ferrostep-{version}-{triple}.tar.gz")
}

/// A template with its values.
fn filled(template: &str, value: impl Fn(&str) -> Result<String, Failure>) -> Result<String, Failure> {
    let mut text = String::new();
    for (place, part) in template.split(MARK).enumerate() {
        // Every second part is between two marks.
        if place % 2 == 0 { text.push_str(part) } else { text.push_str(&value(part)?) }
    }
    if template.matches(MARK).count().is_multiple_of(2) { Ok(text) } else { Err(format!("an odd number of {MARK}")) }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::release::systems::SYSTEMS;

    fn folder(name: &str) -> tempfile::TempDir {
        tempfile::Builder::new().prefix(name).tempdir().unwrap()
    }

    #[test]
    fn recipes_name_the_archives_with_their_checksums() {
        let folder = folder("recipes");
        for one in SYSTEMS {
            fs::write(folder.path().join(archive("1.2.3", one.triple)), "abc").unwrap();
        }
        write(folder.path(), "1.2.3", "https://example.org/ferrostep/").unwrap();
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        for (name, _) in RECIPES {
            let recipe = read(&folder.path().join("recipes").join(name)).unwrap();
            assert!(recipe.contains("https://example.org/ferrostep") && recipe.contains("1.2.3"), "{recipe}");
            assert_eq!(recipe.matches(abc).count(), 2, "{recipe}");
            assert!(!recipe.contains(MARK) && !recipe.contains("ferrostep//"), "{recipe}");
        }
    }

    #[test]
    fn a_missing_archive_is_an_error_that_names_it() {
        let folder = folder("recipes");
        let failure = write(folder.path(), "1.2.3", "https://example.org").unwrap_err();
        assert!(failure.contains("ferrostep-1.2.3-") && failure.contains(".tar.gz"), "{failure}");
        assert!(!folder.path().join("recipes").exists());
    }

    #[test]
    fn a_template_with_an_unknown_value_or_half_a_mark_is_an_error() {
        let value = |key: &str| if key == "a" { Ok("1".to_owned()) } else { Err(format!("unknown {key}")) };
        assert_eq!(filled("x@a@y@a@", value), Ok("x1y1".to_owned()));
        assert_eq!(filled("x@b@", value), Err("unknown b".to_owned()));
        assert!(filled("x@a", value).is_err());
    }
}
