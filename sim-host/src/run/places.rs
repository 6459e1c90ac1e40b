//! Which files a run reads and writes, and whether two of them are one.

use super::names;
use crate::printable::printable;
use crate::record::is_standard_output;
use crate::scenario::{Override, is_standard_input};
use std::fs;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::{Component, Path, PathBuf};

/// What a run is asked to read and to write, as the user named it.
#[derive(Clone, Copy, Debug)]
pub struct Wanted<'a> {
    /// The scenario; `-` is standard input.
    pub scenario: &'a Path,
    /// What replaces values of it.
    pub sets: &'a [Override],
    /// The bench file.
    pub bench: Option<&'a Path>,
    /// Folder of outputs.
    pub out: Option<&'a Path>,
    /// File for the summary.
    pub json: Option<&'a Path>,
    /// File for the verdicts.
    pub junit: Option<&'a Path>,
    /// The command that was typed.
    pub command: &'a str,
}

/// An output that is an input, or another output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Clash {
    /// The outputs that are concerned.
    pub outputs: Vec<PathBuf>,
    /// Both, named, and what to do.
    pub message: String,
}

/// A file with what it is to the user.
struct Named {
    what: String,
    path: PathBuf,
    keys: Vec<Key>,
}

/// What two names of one file have in common.
#[derive(PartialEq)]
enum Key {
    /// Without links, `.` and `..`; the file need not be there.
    Path(PathBuf),
    /// Device and number.
    Inode(u64, u64),
    StandardOutput,
}

impl Wanted<'_> {
    /// Every output that is the scenario, the bench file or another output: by its path, through links, or as another name of the file.
    pub fn clashes(&self) -> Vec<Clash> {
        let (inputs, outputs) = (self.inputs(), self.outputs());
        let mut clashes = Vec::new();
        for (n, output) in outputs.iter().enumerate() {
            if let Some(input) = inputs.iter().find(|input| input.is(output)) {
                let message = format!(
                    "{} is {}, which a run must not overwrite; name another output",
                    output.what, input.what
                );
                clashes.push(Clash { outputs: vec![output.path.clone()], message });
            }
            for other in outputs.iter().skip(n + 1).filter(|other| other.is(output)) {
                let message = format!(
                    "{} and {} are one file; give each output a file of its own",
                    output.what, other.what
                );
                clashes.push(Clash { outputs: vec![output.path.clone(), other.path.clone()], message });
            }
        }
        clashes
    }

    fn inputs(&self) -> Vec<Named> {
        let scenario = match is_standard_input(self.scenario) {
            true => Named::new("the scenario at standard input".to_owned(), Path::new("/dev/stdin")),
            false => Named::new(format!("the scenario {}", shown(self.scenario)), self.scenario),
        };
        let bench = self.bench.map(|path| Named::new(format!("the bench file {}", shown(path)), path));
        let read = files_named_in(self.scenario, self.sets).into_iter();
        let read = read.map(|path| Named::new(format!("{}, which the scenario reads", shown(&path)), &path));
        [Some(scenario), bench].into_iter().flatten().chain(read).collect()
    }

    fn outputs(&self) -> Vec<Named> {
        let option = |name: &str, path: Option<&Path>| {
            path.map(|path| Named::new(format!("--{name} {}", shown(path)), path))
        };
        let of_folder = self.out.map(|folder| {
            let file =
                |path: PathBuf| Named::new(format!("--out {} ({})", shown(folder), file_name(&path)), &path);
            names::in_folder(folder).into_iter().map(file).collect::<Vec<_>>()
        });
        let named = [option("json", self.json), option("junit", self.junit)].into_iter().flatten();
        named.chain(of_folder.into_iter().flatten()).collect()
    }
}

/// The first file of `folder` that a sweep may write or remove, by these names or by those of other commands, and that is one of `inputs`.
pub fn overwritten(folder: &Path, names: &[&str], inputs: &[PathBuf]) -> Option<String> {
    let outputs = names.iter().map(|name| folder.join(name)).chain(names::in_folder(folder));
    let outputs: Vec<_> = outputs.map(|path| Named::new(file_name(&path), &path)).collect();
    inputs.iter().find_map(|input| {
        let named = Named::new(shown(input), input);
        let output = outputs.iter().find(|output| output.is(&named))?;
        let (folder, output) = (shown(folder), &output.what);
        Some(format!(
            "--out {folder} ({output}) is {}, which must not be overwritten; name another folder",
            named.what
        ))
    })
}

/// The files that a scenario's text, or what replaces a part of it, names by `file = "..."`: a graph, a time series. They are looked for before it
/// is read, since what is in the way of outputs goes first; what a comment names is safe, too.
#[must_use]
pub fn files_named_in(scenario: &Path, sets: &[Override]) -> Vec<PathBuf> {
    // A pipe gives its text once, to whoever reads the scenario; a device has no end.
    let is_file = !is_standard_input(scenario) && scenario.is_file();
    let text = if is_file { fs::read_to_string(scenario).unwrap_or_default() } else { String::new() };
    let folder = scenario.parent().unwrap_or(Path::new(""));
    let quoted = |rest: &str| {
        let value = rest.trim_start_matches(['"', '\'']).trim_start().strip_prefix('=')?.trim_start();
        let quote = value.chars().next().filter(|quote| ['"', '\''].contains(quote))?;
        Some(value.get(1..)?.split(quote).next()?.to_owned())
    };
    let settings: Vec<_> = sets.iter().map(Override::setting).collect();
    // A bare string needs no quotes.
    let bare = settings.iter().filter_map(|setting| setting.split_once("file="));
    let bare = bare.map(|(_, value)| value.trim().trim_matches(['"', '\'']).to_owned());
    let texts = std::iter::once(&text).chain(&settings);
    let named = texts.flat_map(|text| text.split("file").skip(1).filter_map(quoted));
    named.chain(bare).map(|name| folder.join(name)).collect()
}

/// Whether two names are of one file, by path, through links, or as another name of it.
#[must_use]
pub fn is_one_file(one: &Path, other: &Path) -> bool {
    Named::new(String::new(), one).is(&Named::new(String::new(), other))
}

fn shown(path: &Path) -> String {
    printable(&path.display().to_string()).into_owned()
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or(String::new(), |name| printable(&name.to_string_lossy()).into_owned())
}

impl Named {
    fn new(what: String, path: &Path) -> Self {
        Self { what, path: path.to_owned(), keys: keys(path) }
    }

    fn is(&self, other: &Self) -> bool {
        self.keys.iter().any(|key| other.keys.contains(key))
    }
}

fn keys(path: &Path) -> Vec<Key> {
    let to_standard_output = is_standard_output(path);
    let path = if to_standard_output { Path::new("/dev/stdout") } else { path };
    let metadata = fs::metadata(path).ok();
    let kind = metadata.as_ref().map(fs::Metadata::file_type);
    // `/dev/null` and terminals take everything from everybody.
    let is_shared = kind.is_some_and(|kind| kind.is_char_device());
    let mut keys = Vec::new();
    if to_standard_output {
        keys.push(Key::StandardOutput);
    }
    if !is_shared {
        keys.push(Key::Path(resolve(path, MOST_LINKS)));
        keys.extend(metadata.map(|metadata| Key::Inode(metadata.dev(), metadata.ino())));
    }
    keys
}

/// The most symbolic links on a path, as Linux has it.
const MOST_LINKS: usize = 40;

/// A path from the root, without links, `.` and `..`. What is not there counts as a plain name.
fn resolve(path: &Path, links: usize) -> PathBuf {
    let mut real = PathBuf::new();
    for component in std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).components() {
        match component {
            Component::Prefix(_) | Component::RootDir => real.push(component),
            Component::CurDir => {}
            // There is no link in `real`, so that its parent is the one that is meant.
            Component::ParentDir => {
                real.pop();
            }
            Component::Normal(name) => {
                let next = real.join(name);
                real = match fs::read_link(&next) {
                    Ok(target) if links > 0 => resolve(&real.join(target), links - 1),
                    _ => next,
                };
            }
        }
    }
    real
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    fn clashes(wanted: Wanted<'_>) -> Vec<String> {
        wanted.clashes().into_iter().map(|clash| clash.message).collect()
    }

    fn wanted<'a>(scenario: &'a Path, json: &'a Path) -> Wanted<'a> {
        Wanted { scenario, sets: &[], bench: None, out: None, json: Some(json), junit: None, command: "" }
    }

    #[test]
    fn one_file_is_found_under_all_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("a.toml"), "").unwrap();
        fs::create_dir(at("deep")).unwrap();
        symlink("../a.toml", at("deep/link")).unwrap();
        symlink("deep", at("way")).unwrap();
        fs::hard_link(at("a.toml"), at("hard")).unwrap();
        fs::write(at("other"), "").unwrap();
        for name in ["a.toml", "./a.toml", "deep/../a.toml", "deep/link", "way/link", "way/../a.toml", "hard"]
        {
            let found = clashes(wanted(&at("a.toml"), &at(name)));
            assert_eq!(found.len(), 1, "{name}");
            assert!(found[0].contains("--json ") && found[0].contains("the scenario "), "{}", found[0]);
        }
        for name in ["other", "none", "deep/a.toml"] {
            assert_eq!(clashes(wanted(&at("a.toml"), &at(name))), Vec::<String>::new(), "{name}");
        }
    }

    #[test]
    fn files_that_a_setting_brings_in_are_inputs() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("a.toml"), "graph = { file = 'old.csv' }").unwrap();
        for setting in ["graph.file=g.csv", "graph.file='g.csv'", "graph={ file = \"g.csv\" }"] {
            let sets = [Override::parse(setting).unwrap()];
            for (name, count) in [("g.csv", 1), ("old.csv", 1), ("other.csv", 0)] {
                let (scenario, json) = (at("a.toml"), at(name));
                let found = clashes(Wanted { sets: &sets, ..wanted(&scenario, &json) });
                assert_eq!(found.len(), count, "{setting} {name}");
            }
        }
    }

    #[test]
    fn outputs_that_are_not_there_yet_are_compared_too() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        symlink("new/summary.json", at("dangling")).unwrap();
        let (scenario, out, json, junit) =
            (at("a.toml"), at("new"), at("dangling"), at("x/../new/./can.log"));
        let wanted = Wanted {
            scenario: &scenario,
            sets: &[],
            bench: None,
            out: Some(&out),
            json: Some(&json),
            junit: Some(&junit),
            command: "",
        };
        let found = clashes(wanted);
        assert_eq!(found.len(), 2, "{found:?}");
        assert!(found[0].contains("(summary.json) are one file"), "{}", found[0]);
        assert!(found[1].contains("(can.log) are one file"), "{}", found[1]);
    }

    #[test]
    fn devices_are_shared_and_standard_output_is_not() {
        let null = Path::new("/dev/null");
        let of = |json, junit| {
            clashes(Wanted { junit: Some(Path::new(junit)), ..wanted(null, Path::new(json)) }).len()
        };
        assert_eq!((of("/dev/null", "/dev/null"), of("-", "-"), of("-", "/dev/stdout")), (0, 1, 1));
    }
}
