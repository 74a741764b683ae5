//! The source tree as the house rules see it: files, words and paths with their lines.
//!
//! No parser of Rust: comments and literals are blanked out, what is left is cut into words
//! and marks, and paths are followed through `use` groups. That is enough for rules about
//! names, and it fails loudly where it understands too little.

use std::fmt;
use std::fs;
use std::path::{Path as FilePath, PathBuf};

/// A file of the tree.
pub struct SourceFile {
    /// From the root of the package, with forward slashes.
    pub name: String,
    /// As it is.
    pub text: String,
}

/// A path in code, as `crate::control::tick` or `std::net::UdpSocket`.
pub struct Path {
    pub line: usize,
    pub parts: Vec<String>,
}

impl Path {
    /// The module of this crate that it leads into.
    pub fn crate_module(&self) -> Option<&str> {
        (self.parts[0] == "crate").then(|| self.parts.get(1).map(String::as_str))?
    }
}

impl fmt::Display for Path {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.parts.join("::"))
    }
}

/// Where the package is.
pub fn root() -> &'static FilePath {
    FilePath::new(env!("CARGO_MANIFEST_DIR"))
}

/// One file by its name.
pub fn file(name: &str) -> SourceFile {
    let text = fs::read_to_string(root().join(name));
    SourceFile { name: name.to_owned(), text: text.unwrap_or_else(|e| panic!("{name}: {e}")) }
}

/// Every Rust file under these folders (or these files), by name.
pub fn files(places: &[&str]) -> Vec<SourceFile> {
    let mut found = Vec::new();
    let mut open: Vec<PathBuf> = places.iter().map(|place| root().join(place)).collect();
    while let Some(path) = open.pop() {
        if path.is_dir() {
            let entries = fs::read_dir(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
            open.extend(entries.map(|entry| entry.expect("a folder can be read").path()));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let name = path.strip_prefix(root()).expect("inside the package");
            found.push(file(&name.to_string_lossy().replace('\\', "/")));
        }
    }
    assert!(!found.is_empty(), "no Rust file in {places:?}");
    found.sort_by(|a, b| a.name.cmp(&b.name));
    found
}

impl SourceFile {
    /// `name:line`.
    pub fn at(&self, line: usize) -> String {
        format!("{}:{line}", self.name)
    }

    /// The top module that it belongs to; empty for the crate root and for other crates.
    pub fn module(&self) -> &str {
        let Some(inside) = self.name.strip_prefix("src/") else { return "" };
        let top = inside.split('/').next().unwrap_or_default();
        let top = top.strip_suffix(".rs").unwrap_or(top);
        if ["lib", "main"].contains(&top) { "" } else { top }
    }

    /// How many modules deep its code is: 1 for `src/link.rs` and `src/control/mod.rs`.
    fn depth(&self) -> usize {
        let inside = self.name.strip_prefix("src/").unwrap_or(&self.name);
        inside.trim_end_matches(".rs").trim_end_matches("/mod").split('/').count()
    }

    /// True for files that are compiled for tests only.
    pub fn is_test(&self) -> bool {
        let stem = self.name.trim_end_matches(".rs");
        stem.split('/').any(|part| part == "tests" || part == "fixtures")
            || stem.ends_with("_tests")
    }

    /// Words and marks of the code, with their lines, up to the tests that close the file.
    pub fn words(&self) -> Vec<(usize, String)> {
        let mut words: Vec<(usize, String)> = Vec::new();
        for (i, line) in blanked(&self.text).lines().enumerate() {
            let mut rest = line.trim_start();
            while let Some(first) = rest.chars().next() {
                let word = |c: char| c.is_alphanumeric() || c == '_';
                let length = if word(first) {
                    rest.find(|c: char| !word(c)).unwrap_or(rest.len())
                } else if rest.starts_with("::") {
                    2
                } else {
                    first.len_utf8()
                };
                words.push((i + 1, rest[..length].to_owned()));
                rest = rest[length..].trim_start();
            }
        }
        let end = closing_tests(&words);
        words.truncate(end);
        words
    }

    /// Every path of two parts or more, and what `use` names alone. Paths through enough
    /// `super` to reach the crate root begin with `crate`.
    pub fn paths(&self) -> Vec<Path> {
        let words = self.words();
        let mut paths = Vec::new();
        let mut at = 0;
        while at < words.len() {
            let name = words[at].1.starts_with(|c: char| c.is_alphabetic() || c == '_');
            let begins = name && (at == 0 || words[at - 1].1 != "::");
            let used = at > 0 && words[at - 1].1 == "use";
            let longer = words.get(at + 1).is_some_and(|(_, word)| word == "::");
            if begins && (used || longer) {
                at = follow(&words, at, &[], &mut paths);
            } else {
                at += 1;
            }
        }
        for path in &mut paths {
            let up = path.parts.iter().take_while(|part| *part == "super").count();
            if up >= self.depth() {
                path.parts.splice(..up, ["crate".to_owned()]);
            }
        }
        paths
    }
}

/// Follows one path or the members of a group from `at`; returns where it ends.
fn follow(
    words: &[(usize, String)],
    mut at: usize,
    before: &[String],
    paths: &mut Vec<Path>,
) -> usize {
    let mut parts = before.to_vec();
    let line = words[at].0;
    loop {
        let word = |at: usize| words.get(at).map_or("", |(_, word)| word.as_str());
        if word(at) == "{" {
            at += 1;
            while !["}", ""].contains(&word(at)) {
                at = if word(at) == "," { at + 1 } else { follow(words, at, &parts, paths) };
            }
            return at + 1;
        }
        // `a::b as c` ends at b; turbofish and associated paths end at the mark.
        let name = word(at).starts_with(|c: char| c.is_alphanumeric() || c == '_');
        if name {
            parts.push(word(at).to_owned());
            at += 1;
        }
        if name && word(at) == "::" {
            at += 1;
            continue;
        }
        if parts.last().is_some_and(|part| part == "self") {
            parts.pop();
        }
        paths.push(Path { line, parts });
        if word(at) == "as" {
            at += 2;
        } else if !name {
            at += 1;
        }
        return at;
    }
}

/// Where `#[cfg(test)] mod tests {` begins, or the end.
fn closing_tests(words: &[(usize, String)]) -> usize {
    let is = |at: usize, wanted: &str| words.get(at).is_some_and(|(_, word)| word == wanted);
    let marks = ["#", "[", "cfg", "(", "test", ")", "]"];
    let begins = |at: usize| {
        let mut next = at + marks.len();
        let marked = marks.iter().enumerate().all(|(i, mark)| is(at + i, mark));
        // pub(super) mod tests {
        while marked && next < at + marks.len() + 5 && !is(next, "mod") {
            next += 1;
        }
        marked && is(next, "mod") && is(next + 2, "{")
    };
    (0..words.len()).find(|&at| begins(at)).unwrap_or(words.len())
}

/// The text with comments, strings and characters replaced by blanks; lines stay lines.
fn blanked(text: &str) -> String {
    let chars: Vec<char> = text.chars().collect();
    let mut out = String::with_capacity(text.len());
    let mut at = 0;
    while at < chars.len() {
        let length = literal(&chars[at..], at > 0 && is_word(chars[at - 1]));
        if length == 0 {
            out.push(chars[at]);
            at += 1;
        } else {
            let blank = |c: &char| if *c == '\n' { '\n' } else { ' ' };
            out.extend(chars[at..at + length].iter().map(blank));
            at += length;
        }
    }
    out
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Length of the comment or literal that begins here, 0 for none.
fn literal(chars: &[char], inside_word: bool) -> usize {
    let get = |at: usize| chars.get(at).copied().unwrap_or('\0');
    let through = |from: usize, end: &[char]| {
        let found = chars[from..].windows(end.len()).position(|window| window == end);
        found.map_or(chars.len(), |found| from + found + end.len())
    };
    match (get(0), get(1)) {
        ('/', '/') => through(2, &['\n']) - usize::from(chars.contains(&'\n')),
        ('/', '*') => through(2, &['*', '/']),
        ('"', _) => quoted(chars, '"'),
        ('r', '"' | '#') if !inside_word => {
            let hashes = chars[1..].iter().take_while(|c| **c == '#').count();
            let end: Vec<_> = std::iter::once('"').chain(vec!['#'; hashes]).collect();
            if get(1 + hashes) == '"' { through(2 + hashes, &end) } else { 0 }
        }
        // A character, not a lifetime.
        ('\'', '\\') => quoted(chars, '\''),
        ('\'', _) if get(2) == '\'' => 3,
        _ => 0,
    }
}

/// Length of a literal in `quote`s with escapes.
fn quoted(chars: &[char], quote: char) -> usize {
    let mut at = 1;
    while at < chars.len() && chars[at] != quote {
        at += if chars[at] == '\\' { 2 } else { 1 };
    }
    (at + 1).min(chars.len())
}

#[test]
fn paths_are_found_through_groups_and_not_in_comments_or_tests() {
    let text = "//! a::b\nuse crate::{x::{self, y as z}, w};\nuse tokio;\nfn f<'a>() -> std::fs::File {\n  \
                let c = ('\"', \"q::r\"); super::super::up::g::<T>()\n}\n#[cfg(test)]\nmod tests {\nuse no::way;\n}";
    let file = SourceFile { name: "src/a/b.rs".into(), text: text.into() };
    let paths = file.paths();
    let found: Vec<_> = paths.iter().map(|path| (path.line, path.to_string())).collect();
    let wanted = [
        (2, "crate::x"),
        (2, "crate::x::y"),
        (2, "crate::w"),
        (3, "tokio"),
        (4, "std::fs::File"),
        (5, "crate::up::g"),
    ];
    assert_eq!(found, wanted.map(|(line, path)| (line, path.to_owned())));
    assert_eq!(file.module(), "a");
}
