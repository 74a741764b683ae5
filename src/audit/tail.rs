//! The last lines of the audit log, for people and programs.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use super::log::aside;
use super::{FILE, KEPT};

/// Longest line that is shown; no line that hapticd writes comes near.
const LONGEST_BYTES: u64 = 64 * 1024;

/// The last `count` lines, oldest first, out of all files that are kept; as they are, also those
/// that a crash cut short.
pub fn tail(state_dir: &Path, count: usize) -> io::Result<Vec<String>> {
    let path = state_dir.join(FILE);
    let mut newest = VecDeque::new();
    for number in 0..=KEPT {
        let path = if number == 0 { path.clone() } else { aside(&path, number) };
        let missing = count - newest.len();
        if missing == 0 {
            break;
        }
        match File::open(&path) {
            Ok(file) => {
                for line in last(BufReader::new(file), missing)?.into_iter().rev() {
                    newest.push_front(line);
                }
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(error),
        }
    }
    Ok(newest.into())
}

fn last(mut from: impl BufRead, count: usize) -> io::Result<VecDeque<String>> {
    let mut lines = VecDeque::new();
    let mut line = Vec::new();
    loop {
        line.clear();
        if from.by_ref().take(LONGEST_BYTES).read_until(b'\n', &mut line)? == 0 {
            return Ok(lines);
        }
        let text = String::from_utf8_lossy(&line);
        let text = text.trim_end();
        if text.is_empty() {
            continue;
        }
        if lines.len() == count {
            lines.pop_front();
        }
        lines.push_back(text.to_owned());
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn the_last_lines_come_from_as_many_files_as_it_takes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(FILE);
        assert!(tail(folder.path(), 5).unwrap().is_empty());
        fs::write(&path, "5\n6\n").unwrap();
        fs::write(aside(&path, 1), "3\n\n4").unwrap();
        fs::write(aside(&path, 3), "1\n2\n").unwrap();
        assert_eq!(tail(folder.path(), 1).unwrap(), ["6"]);
        assert_eq!(tail(folder.path(), 3).unwrap(), ["4", "5", "6"]);
        assert_eq!(tail(folder.path(), 100).unwrap(), ["1", "2", "3", "4", "5", "6"]);
        assert!(tail(folder.path(), 0).unwrap().is_empty());
    }

    #[test]
    fn what_is_no_text_and_what_has_no_end_does_not_keep_the_rest_from_being_read() {
        let folder = tempfile::tempdir().unwrap();
        let mut bytes = vec![0xff; 3 * LONGEST_BYTES as usize];
        bytes.extend(b"\nlast\n");
        fs::write(folder.path().join(FILE), bytes).unwrap();
        let lines = tail(folder.path(), 2).unwrap();
        assert_eq!(lines.last().unwrap(), "last");
        assert!(lines[0].len() <= 3 * LONGEST_BYTES as usize);
    }
}
