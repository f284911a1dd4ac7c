//! The import rules of ARCHITECTURE.md hold in the source.

use std::{
    fs,
    path::{Path, PathBuf},
};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

struct Rule {
    source: String,
    forbidden: Vec<String>,
}

/// The rows of the table under "What must not be imported".
fn rules() -> Vec<Rule> {
    let text = fs::read_to_string(Path::new(ROOT).join("ARCHITECTURE.md")).unwrap();
    let section = text
        .split("## What must not be imported")
        .nth(1)
        .expect("the section stands");
    let section = section.split("\n## ").next().unwrap();
    section
        .lines()
        .filter(|line| line.starts_with("| `src/"))
        .map(|line| {
            let mut words = line.split('`').skip(1).step_by(2).map(str::to_owned);
            Rule {
                source: words.next().unwrap(),
                forbidden: words.collect(),
            }
        })
        .collect()
}

/// The Rust files of `src/a/b`: those in the folder, or `src/a/b.rs`.
fn sources(path: &Path) -> Vec<PathBuf> {
    if path.is_file() {
        return vec![path.to_owned()];
    }
    let mut found = Vec::new();
    let file = path.with_extension("rs");
    if file.is_file() {
        found.push(file);
    }
    for entry in fs::read_dir(path).into_iter().flatten() {
        let entry = entry.unwrap().path();
        if entry.is_dir() {
            found.extend(sources(&entry));
        } else if entry.extension().is_some_and(|extension| extension == "rs") {
            found.push(entry);
        }
    }
    found
}

/// `word` stands in `code` on its own, not as a part of a longer name.
fn names(code: &str, word: &str) -> bool {
    let is_name = |letter: char| letter.is_alphanumeric() || letter == '_';
    code.match_indices(word).any(|(at, _)| {
        let before = code[..at].chars().next_back();
        let after = code[at + word.len()..].chars().next();
        !before.is_some_and(is_name) && !after.is_some_and(is_name)
    })
}

/// The modules that `use crate::{a::X, b};` names, each as `crate::a` with its line.
fn grouped_imports(code: &str) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    for (start, opening) in code.match_indices("use crate::{") {
        let mut depth = 1;
        let mut expects_name = true;
        let mut name = String::new();
        for (offset, letter) in code[start + opening.len()..].char_indices() {
            let in_name = letter.is_alphanumeric() || letter == '_';
            if depth == 1 && expects_name && in_name {
                name.push(letter);
                continue;
            }
            if !name.is_empty() {
                let line = code[..start + opening.len() + offset].lines().count();
                found.push((line, format!("crate::{}", std::mem::take(&mut name))));
                expects_name = false;
            }
            match letter {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 1 => expects_name = true,
                _ => {}
            }
            if depth == 0 {
                break;
            }
        }
    }
    found
}

fn violations(rule: &Rule, file: &Path) -> Vec<String> {
    let text = fs::read_to_string(file).unwrap();
    // Tests may use what the layer itself may not, such as a runtime.
    let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap();
    let lines = code
        .lines()
        .enumerate()
        .map(|(number, line)| (number + 1, line.to_owned()));
    lines
        .filter(|(_, line)| !line.trim_start().starts_with("//"))
        .chain(grouped_imports(code))
        .flat_map(|(number, line)| {
            let broken = rule.forbidden.iter().filter(move |word| names(&line, word));
            broken.map(move |word| {
                format!(
                    "{}:{number}: {} must not name {word}",
                    file.display(),
                    rule.source
                )
            })
        })
        .collect()
}

#[test]
fn layers_point_one_way() {
    let rules = rules();
    assert!(
        rules.len() >= 8,
        "the table of ARCHITECTURE.md was not found"
    );
    let mut found = Vec::new();
    for rule in &rules {
        let files = sources(&Path::new(ROOT).join(&rule.source));
        assert!(
            !files.is_empty(),
            "{} holds no source: correct ARCHITECTURE.md",
            rule.source
        );
        for file in files {
            found.extend(violations(rule, &file));
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn a_forbidden_import_would_be_seen() {
    let rule = Rule {
        source: "src/x".into(),
        forbidden: vec!["crate::web".into(), "rand".into()],
    };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("x.rs");
    fs::write(
        &file,
        "use crate::web::Error;\nuse rand_chacha::X;\n// crate::web\nuse rand::Rng;\nuse crate::{\n    study::{web, X},\n    web::{self, Y},\n};\n",
    )
    .unwrap();
    assert_eq!(
        violations(&rule, &file).len(),
        3,
        "once by path, once as a crate, once in a group"
    );
}

#[test]
fn every_module_stands_in_the_map() {
    let text = fs::read_to_string(Path::new(ROOT).join("ARCHITECTURE.md")).unwrap();
    let library = fs::read_to_string(Path::new(ROOT).join("src/lib.rs")).unwrap();
    let missing: Vec<_> = library
        .lines()
        .filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';'))
        .filter(|module| !text.contains(&format!("`{module}`")))
        .collect();
    assert!(missing.is_empty(), "not in ARCHITECTURE.md: {missing:?}");
}

#[test]
fn sqlx_resolves_to_one_version() {
    let lock = fs::read_to_string(Path::new(ROOT).join("Cargo.lock")).unwrap();
    assert_eq!(lock.matches("name = \"sqlx\"").count(), 1);
}
