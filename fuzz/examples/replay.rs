//! Runs inputs through their target without libFuzzer: a finding under a debugger, or all seeds.
//!
//! `cargo run --example replay -- TARGET FILE_OR_DIRECTORY...`

use std::path::{Path, PathBuf};
use std::process::exit;

use hapticd_fuzz::TARGETS;

fn files(path: &Path) -> std::io::Result<Vec<PathBuf>> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let mut files = Vec::new();
    for entry in std::fs::read_dir(path)? {
        files.extend(self::files(&entry?.path())?);
    }
    files.sort();
    Ok(files)
}

fn main() -> std::io::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let wanted = arguments.next().unwrap_or_default();
    let Some((_, check)) = TARGETS.iter().find(|(name, _)| *name == wanted) else {
        let names: Vec<_> = TARGETS.iter().map(|(name, _)| *name).collect();
        eprintln!("target {wanted:?}: must be one of {}", names.join(", "));
        exit(2);
    };
    let mut count = 0;
    for path in arguments {
        for file in files(Path::new(&path))? {
            eprintln!("{}", file.display());
            check(&std::fs::read(&file)?);
            count += 1;
        }
    }
    println!("{count} inputs, nothing found");
    Ok(())
}
