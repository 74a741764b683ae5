//! A report in Markdown with its pictures, in a folder of its own.

use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::analysis::papers::page;
use crate::plot::Figure;

/// A report that is being written.
pub struct Report {
    folder: PathBuf,
    text: String,
}

impl Report {
    /// Begins a report in a folder, which is made where there is none.
    pub fn begin(folder: &Path, title: &str) -> anyhow::Result<Self> {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make {}", folder.display()))?;
        Ok(Self { folder: folder.to_owned(), text: format!("# {title}\n") })
    }

    /// A heading.
    pub fn heading(&mut self, words: &str) {
        self.text += &format!("\n## {words}\n");
    }

    /// A paragraph.
    pub fn say(&mut self, words: &str) {
        self.text += &format!("\n{words}\n");
    }

    /// A table; every row has as many cells as the head.
    pub fn table(&mut self, head: &[&str], rows: &[Vec<String>]) {
        self.text += &format!("\n{}", page::table(head, rows));
    }

    /// A picture, as NAME.svg and NAME.png, and what it shows.
    pub fn picture(&mut self, name: &str, caption: &str, figure: &Figure) -> anyhow::Result<()> {
        for ending in ["svg", "png"] {
            figure.save(&self.folder.join(format!("{name}.{ending}")))?;
        }
        self.text += &format!("\n![{caption}]({name}.svg)\n\n*{caption}* ([PNG]({name}.png))\n");
        Ok(())
    }

    /// Writes `report.md` and says where it is.
    pub fn finish(self) -> anyhow::Result<PathBuf> {
        let path = self.folder.join("report.md");
        std::fs::write(&path, self.text)
            .with_context(|| format!("cannot write {}", path.display()))?;
        Ok(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_is_a_folder_with_text_and_pictures() {
        let folder = tempfile::tempdir().unwrap();
        let mut report = Report::begin(&folder.path().join("new"), "Title").unwrap();
        report.table(&["a", "b"], &[vec!["1".into(), "2".into()]]);
        report.picture("empty", "Nothing", &Figure::single(Default::default())).unwrap();
        let path = report.finish().unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains("| a | b |\n| --- | --- |\n| 1 | 2 |"), "{text}");
        assert!(
            path.with_file_name("empty.svg").exists() && path.with_file_name("empty.png").exists()
        );
    }
}
