//! `hapticd experiment papers`: one page for each of the three papers, with pictures and table.
//!
//! What is computed, judged and said is [`crate::analysis::papers`]; this runs it, draws, and
//! writes. Pages, table and pictures depend on the code alone: a second run changes nothing.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, ensure};
use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::paper_pictures as pictures;
use super::wall_following::{save, stop_on_ctrl_c};
use crate::analysis::papers::{Page, cho, index, kim, singh};
use crate::cli::design::progress_bar;
use crate::plot::Figure;

/// A paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Paper {
    /// The braked five-bar
    #[value(name = "cho-2005")]
    Cho,
    /// The redundant 3-RRR
    #[value(name = "kim-2003")]
    Kim,
    /// The symmetric five-bar
    Singh,
}

/// One page per paper: its tables and figures beside ours, its conclusions with verdicts
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd experiment papers --out docs/papers
  hapticd experiment papers --quick --out /tmp/papers
  hapticd experiment papers --paper kim-2003,singh --out /tmp/papers
  hapticd experiment papers --quick --out /tmp/papers --json | jq '.pages[].verdicts'

The whole of it follows walls about 4,000 times in virtual time: some minutes. Ctrl-C stops it;
nothing is written before everything is computed.")]
pub struct Papers {
    /// Folder for the pages, README.md, the table and the pictures
    #[arg(long, value_name = "DIR", default_value = "docs/papers")]
    out: PathBuf,
    /// Which; README.md is written where all are
    #[arg(
        long,
        value_name = "NAMES",
        value_delimiter = ',',
        value_enum,
        default_value = "cho-2005,kim-2003,singh"
    )]
    paper: Vec<Paper>,
    /// Few laws, courses, starts and poses: half a minute
    #[arg(long)]
    quick: bool,
    /// Print the verdicts as one JSON object, and nothing else, on stdout
    #[arg(long)]
    json: bool,
}

/// A page with what stands beside it.
struct Written {
    page: Page,
    pictures: Vec<(&'static str, Figure)>,
    /// Name and text of a table.
    table: Option<(&'static str, String)>,
}

impl Papers {
    /// Computes, draws, writes.
    pub fn run(self) -> anyhow::Result<()> {
        // A folder that cannot be made is told before the minutes, not after.
        std::fs::create_dir_all(&self.out)
            .with_context(|| format!("cannot make {}", self.out.display()))?;
        let stop = stop_on_ctrl_c()?;
        let mut all = Vec::new();
        for paper in [Paper::Cho, Paper::Kim, Paper::Singh] {
            if self.paper.contains(&paper) {
                all.push(self.made(paper, &stop)?);
            }
        }
        ensure!(!stop.load(Ordering::Relaxed), "stopped; nothing was written");
        let mut paths = Vec::new();
        for one in &all {
            paths.extend(write(&self.out, one)?);
        }
        let pages: Vec<Page> = all.into_iter().map(|one| one.page).collect();
        if pages.len() == 3 {
            paths.push(save(&self.out.join("README.md"), &index(&pages))?);
        }
        if self.json {
            say!("{}", to_json(&self.out, &pages));
        } else {
            for path in paths {
                say!("{}", path.display());
            }
        }
        Ok(())
    }

    fn made(&self, paper: Paper, stop: &AtomicBool) -> anyhow::Result<Written> {
        Ok(match paper {
            Paper::Cho => {
                let bar = progress_bar(cho::steps(self.quick), "slides and starts");
                let found = cho::measure(self.quick, &|| bar.inc(1), stop);
                bar.finish_and_clear();
                let found = found?;
                let table = Some((
                    "cho-2005-wall-following.csv",
                    cho::csv(&cho::study(self.quick), &found.rows),
                ));
                Written { page: cho::page(&found), pictures: pictures::cho(&found)?, table }
            }
            Paper::Kim => {
                let found = kim::measure(if self.quick { 200 } else { 2000 })?;
                let pictures = pictures::kim(&found)?;
                Written { page: kim::page(&found), pictures, table: None }
            }
            Paper::Singh => {
                let found = singh::measure()?;
                let pictures = pictures::singh(&found)?;
                Written { page: singh::page(&found), pictures, table: None }
            }
        })
    }
}

/// The page, its table and its pictures; the paths.
fn write(folder: &Path, one: &Written) -> anyhow::Result<Vec<PathBuf>> {
    let (mut text, mut paths) = (one.page.text.clone(), Vec::new());
    if let Some((name, text)) = &one.table {
        paths.push(save(&folder.join(name), text)?);
    }
    for (name, figure) in &one.pictures {
        let path = picture(folder, name, figure)?;
        if path.extension().is_some_and(|ending| ending == "svg") {
            text = text.replace(&format!("({name}.png)"), &format!("({name}.svg)"));
        }
        paths.push(path);
    }
    paths.insert(0, save(&folder.join(format!("{}.md", one.page.name)), &text)?);
    Ok(paths)
}

/// A picture as SVG or PNG, whichever is smaller.
fn picture(folder: &Path, name: &str, figure: &Figure) -> anyhow::Result<PathBuf> {
    let [svg, png] = ["svg", "png"].map(|ending| folder.join(format!("{name}.{ending}")));
    figure.save(&png)?;
    figure.save(&svg)?;
    let size = |path: &Path| std::fs::metadata(path).map(|data| data.len());
    let (keep, drop) = if size(&svg)? < size(&png)? { (svg, png) } else { (png, svg) };
    std::fs::remove_file(&drop).with_context(|| format!("cannot remove {}", drop.display()))?;
    Ok(keep)
}

fn to_json(folder: &Path, pages: &[Page]) -> Value {
    let page = |page: &Page| {
        let verdicts = page.conclusions.iter().map(|one| {
            json!({ "where": one.source, "conclusion": one.words, "verdict": one.verdict.name(),
                    "rule": one.rule, "figures": one.figures })
        });
        json!({ "page": page.name, "paper": page.title, "verdicts": verdicts.collect::<Vec<_>>() })
    };
    json!({ "folder": folder.display().to_string(),
            "pages": pages.iter().map(page).collect::<Vec<_>>() })
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::analysis::papers::items;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        papers: Papers,
    }

    fn parsed(words: &[&str]) -> Result<Papers, String> {
        let line = Line::try_parse_from([&["papers"][..], words].concat());
        line.map(|line| line.papers).map_err(|error| error.to_string())
    }

    /// The whole command, quickly: every table and figure of each paper has its heading, every
    /// picture that a page shows is there and nothing beside it.
    #[test]
    fn the_pages_name_every_table_and_figure_and_show_every_picture() {
        let directory = tempfile::tempdir().unwrap();
        let papers = parsed(&["--quick", "--out", directory.path().to_str().unwrap()]).unwrap();
        papers.run().unwrap();
        let mut shown = Vec::new();
        for name in ["cho-2005", "kim-2003", "singh"] {
            let text =
                std::fs::read_to_string(directory.path().join(format!("{name}.md"))).unwrap();
            let headings: Vec<&str> = text
                .lines()
                .filter_map(|line| line.strip_prefix("### ")?.split(':').next())
                .collect();
            assert_eq!(headings, items(name), "{name}");
            assert!(text.contains("**confirmed**") && text.contains("**not testable here**"));
            let mut words = text.split(|c: char| !c.is_alphanumeric());
            assert!(words.all(|word| word != "NaN" && word != "inf"), "{name}");
            // What stands before the first picture is none.
            let pictures = text.split("![").skip(1);
            let targets = pictures.filter_map(|rest| rest.split_once("](")?.1.split(')').next());
            shown.extend(targets.map(str::to_owned));
        }
        let mut bytes = 0;
        let mut drawn = Vec::new();
        for entry in std::fs::read_dir(directory.path()).unwrap() {
            let entry = entry.unwrap();
            bytes += entry.metadata().unwrap().len();
            let name = entry.file_name().into_string().unwrap();
            drawn.extend([".png", ".svg"].iter().any(|end| name.ends_with(end)).then_some(name));
        }
        shown.sort();
        drawn.sort();
        assert_eq!(shown, drawn);
        assert!(bytes < 4_000_000, "{bytes}");
        let table = directory.path().join("cho-2005-wall-following.csv");
        let lines = std::fs::read_to_string(table).unwrap().lines().count();
        assert_eq!(lines, 1 + cho::study(true).cells().len());
        assert!(directory.path().join("README.md").exists());
    }

    /// The two pages that take a second each; their pictures decide by size what they are called.
    #[test]
    fn the_committed_pages_are_those_that_this_code_writes() {
        let directory = tempfile::tempdir().unwrap();
        let out = directory.path().to_str().unwrap();
        parsed(&["--paper", "kim-2003,singh", "--out", out]).unwrap().run().unwrap();
        let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/papers");
        for name in ["kim-2003.md", "singh.md"] {
            let [written, kept] = [directory.path(), &committed]
                .map(|folder| std::fs::read_to_string(folder.join(name)).unwrap());
            let pairs = written.lines().zip(kept.lines());
            let first = pairs.into_iter().find(|(written, kept)| written != kept);
            assert!(
                written == kept,
                "docs/papers/{name} is not what the code writes; `cargo run --release -- \
                 experiment papers --out docs/papers` does. First other line: {first:?}"
            );
        }
    }

    #[test]
    fn a_paper_that_there_is_not_is_refused_by_name() {
        let error = parsed(&["--paper", "colgate"]).unwrap_err();
        assert!(error.contains("colgate") && error.contains("kim-2003"), "{error}");
    }
}
