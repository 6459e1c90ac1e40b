//! The book and the README against the repository: every scenario has a page with its command and its figure,
//! and no link is dead.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use std::fs;
use std::path::{Path, PathBuf};
use system_tests::repository;

const BOOK: &str = "docs/book/src";

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Files below `folder` that end in `.extension`, sorted.
fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path, extension));
        } else if path.extension().is_some_and(|found| found == extension) {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// Names of the scenarios, without `.toml`.
fn scenarios() -> Vec<String> {
    let stem = |path: &PathBuf| path.file_stem().unwrap().to_string_lossy().into_owned();
    files(&repository("scenarios"), "toml").iter().map(stem).collect()
}

/// `text` without fenced code, which has no links.
fn prose(text: &str) -> String {
    text.split("```").step_by(2).collect()
}

/// Targets of the links and images of a page: `[text](target)`.
fn targets(text: &str) -> Vec<String> {
    let target = |rest: &str| rest.split_once(')').map(|(target, _)| target.to_owned());
    prose(text).split("](").skip(1).filter_map(target).collect()
}

/// Anchors of a page, as code hosts derive them from headings.
fn anchors(text: &str) -> Vec<String> {
    let kept = |c: &char| c.is_alphanumeric() || *c == '-' || *c == '_';
    let anchor =
        |heading: &str| heading.trim().to_lowercase().replace(' ', "-").chars().filter(kept).collect();
    let titles = |line: &str| line.starts_with('#').then(|| anchor(line.trim_start_matches('#')));
    prose(text).lines().filter_map(titles).collect()
}

/// What is wrong with a link on `page`, if anything.
fn defect(page: &Path, target: &str) -> Option<String> {
    if target.starts_with("https://") || target.starts_with("http://") {
        return None;
    }
    let (path, anchor) = target.split_once('#').map_or((target, None), |(path, anchor)| (path, Some(anchor)));
    let file = if path.is_empty() { page.to_owned() } else { page.parent().unwrap().join(path) };
    let lost =
        !file.exists() || anchor.is_some_and(|name| !anchors(&read(&file)).iter().any(|found| found == name));
    lost.then(|| format!("{}: {target}", page.display()))
}

#[test]
fn every_scenario_has_a_page_with_its_command_and_its_figure() {
    let folder = repository(BOOK).join("scenarios");
    for name in scenarios() {
        let text = read(&folder.join(format!("{name}.md")));
        let command = format!("\nsim-host run scenarios/{name}.toml\n");
        assert!(text.contains(&command), "{name}.md does not name its command");
        let figure = format!("../figures/{name}.svg");
        assert!(targets(&text).contains(&figure), "{name}.md does not show its figure");
        assert!(folder.join(&figure).is_file(), "{figure} is not there: ./ci.sh gallery");
    }
}

/// Names in `scenarios/NAME.toml` on a page.
fn named(text: &str) -> Vec<&str> {
    let plain = |name: &&str| name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-');
    let parts = text.split("scenarios/").skip(1).filter_map(|rest| rest.split_once(".toml"));
    parts.map(|(name, _)| name).filter(plain).collect()
}

#[test]
fn no_page_or_figure_is_left_of_a_scenario_that_is_gone() {
    let (mut shown, names) = (String::new(), scenarios());
    for page in files(&repository(BOOK), "md") {
        let text = read(&page);
        for name in named(&text) {
            assert!(names.iter().any(|known| known == name), "{}: no scenario {name}", page.display());
        }
        shown += &targets(&text).join("\n");
    }
    for figure in files(&repository(BOOK).join("figures"), "svg") {
        let file = figure.file_name().unwrap().to_string_lossy();
        assert!(shown.contains(&format!("figures/{file}")), "no page shows {file}");
    }
}

#[test]
fn the_summary_and_the_index_list_every_page() {
    let book = repository(BOOK);
    let summary = targets(&read(&book.join("SUMMARY.md")));
    for page in files(&book, "md") {
        let name = page.strip_prefix(&book).unwrap().to_string_lossy().replace('\\', "/");
        assert!(name == "SUMMARY.md" || summary.contains(&name), "SUMMARY.md does not list {name}");
    }
    let index = targets(&read(&book.join("scenarios/README.md")));
    for name in scenarios() {
        assert!(index.contains(&format!("{name}.md")), "scenarios/README.md does not list {name}");
    }
}

#[test]
fn every_relative_link_leads_somewhere() {
    let pages = files(&repository("docs"), "md").into_iter().chain([repository("README.md")]);
    let dead: Vec<_> = pages
        .flat_map(|page| {
            let text = read(&page);
            targets(&text).into_iter().filter_map(move |target| defect(&page, &target)).collect::<Vec<_>>()
        })
        .collect();
    assert!(dead.is_empty(), "dead links:\n{}", dead.join("\n"));
}

/// Blocks of fenced code in `language`.
fn code(text: &str, language: &str) -> Vec<String> {
    let fenced = text.split("```").skip(1).step_by(2);
    fenced.filter_map(|block| block.strip_prefix(&format!("{language}\n")).map(str::to_owned)).collect()
}

#[test]
fn the_code_of_the_worked_example_is_what_is_built() {
    let blocks = code(&read(&repository(BOOK).join("your-own-node.md")), "rust");
    let built = read(&repository("firmware/src/heater.rs"));
    assert!(blocks.len() >= 2);
    for block in blocks {
        assert!(built.contains(&block), "heater.rs does not have:\n{block}");
    }
}

#[test]
fn the_network_of_the_page_on_tests_is_one_that_runs() {
    let blocks = code(&read(&repository(BOOK).join("your-own-test.md")), "rust");
    let built = read(&repository("sim/tests/heaters.rs")) + &read(&repository("sim/README.md"));
    assert!(blocks.len() >= 2);
    for block in blocks {
        assert!(built.contains(&block), "neither sim/tests/heaters.rs nor sim/README.md has:\n{block}");
    }
}

#[test]
fn what_the_evidence_names_is_there() {
    let text = read(&repository(BOOK).join("evidence.md"));
    let mut code = String::new();
    for folder in
        ["law/tests", "node/tests", "sim/src", "sim/tests", "sim-host/tests", "sim-host/src", "tests/tests"]
    {
        files(&repository(folder), "rs").iter().for_each(|path| code += &read(path));
    }
    let names = text.split('`').skip(1).step_by(2).filter(|name| name.matches('_').count() >= 2);
    let missing: Vec<_> = names
        .filter(|name| name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_'))
        .filter(|name| !code.contains(&format!("fn {name}(")))
        .collect();
    assert!(missing.is_empty(), "no such tests: {missing:?}");
}
