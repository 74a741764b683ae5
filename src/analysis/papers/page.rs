//! A page in Markdown: headings, paragraphs, tables, names of pictures, verdicts.
//!
//! A heading of a table or figure of the paper begins with the paper's own number. A picture
//! is a name and a caption here: `NAME.png` beside the page.

use super::verdict::Conclusion;

/// A page that is being written.
#[derive(Clone, Debug)]
pub struct Page {
    /// Name of its file, without an ending.
    pub name: &'static str,
    /// Of the paper.
    pub title: &'static str,
    /// What was written so far.
    pub text: String,
    /// Pictures that the text shows, without an ending.
    pub pictures: Vec<&'static str>,
    /// The paper's conclusions.
    pub conclusions: Vec<Conclusion>,
}

/// A published value beside ours.
#[derive(Clone, Copy, Debug)]
pub struct Compared<'a> {
    /// What it is, with its unit.
    pub what: &'a str,
    /// Where the paper has it.
    pub source: &'a str,
    /// The paper's.
    pub published: f64,
    /// Ours, computed in this run.
    pub here: f64,
    /// Digits behind the point.
    pub digits: usize,
}

impl Compared<'_> {
    /// Ours less the paper's, per cent of the paper's.
    pub fn percent(&self) -> f64 {
        100.0 * (self.here / self.published - 1.0)
    }

    fn row(&self) -> Vec<String> {
        let Self { what, source, published, here, digits } = self;
        vec![
            (*what).to_owned(),
            (*source).to_owned(),
            format!("{published}"),
            format!("{here:.digits$}"),
            format!("{:+.1} %", self.percent() + 0.0),
        ]
    }
}

/// A rounding error in words: its digits may differ from machine to machine.
pub fn tiny(number: f64) -> String {
    if number.abs() < 1e-9 { "less than 1e-9".to_owned() } else { format!("{number:.0e}") }
}

/// A table in Markdown; every row has as many cells as the head.
pub fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let line = |cells: &mut dyn Iterator<Item = &str>| {
        let cells = cells.map(|cell| cell.replace('|', "\\|")).collect::<Vec<_>>();
        format!("| {} |\n", cells.join(" | "))
    };
    let mut text = line(&mut head.iter().copied());
    text += &line(&mut head.iter().map(|_| "---"));
    for row in rows {
        text += &line(&mut row.iter().map(String::as_str));
    }
    text
}

impl Page {
    /// Begins a page.
    pub fn begin(name: &'static str, title: &'static str) -> Self {
        let text = format!("# {title}\n");
        Self { name, title, text, pictures: Vec::new(), conclusions: Vec::new() }
    }

    /// A part of the page.
    pub fn heading(&mut self, words: &str) {
        self.text += &format!("\n## {words}\n");
    }

    /// A table or figure of the paper, by its number.
    pub fn item(&mut self, number: &str, words: &str) {
        self.text += &format!("\n### {number}: {words}\n");
    }

    /// A paragraph.
    pub fn say(&mut self, words: impl AsRef<str>) {
        self.text += &format!("\n{}\n", words.as_ref());
    }

    /// A table.
    pub fn table(&mut self, head: &[&str], rows: &[Vec<String>]) {
        self.text += &format!("\n{}", table(head, rows));
    }

    /// The paper's values beside ours.
    pub fn compare(&mut self, all: &[Compared]) {
        let rows: Vec<_> = all.iter().map(Compared::row).collect();
        self.table(&["quantity", "in the paper", "paper", "here", "difference"], &rows);
    }

    /// A picture, and what to look for in it.
    pub fn picture(&mut self, name: &'static str, caption: &str) {
        self.text += &format!("\n![{caption}]({name}.png)\n");
        self.pictures.push(name);
    }

    /// The paper's conclusions with their verdicts, rules and figures.
    pub fn judge(&mut self, conclusions: Vec<Conclusion>) {
        self.heading("The paper's conclusions");
        self.say(
            "Each verdict is computed from the figures of this run by the rule beside it: a \
             change of the code can turn it. Of a rule in several parts (;) some that hold make \
             it \"confirmed in part\".",
        );
        let row = |one: &Conclusion| {
            vec![
                one.source.to_owned(),
                one.words.to_owned(),
                format!("**{}**", one.verdict),
                one.rule.to_owned(),
                one.figures.clone(),
            ]
        };
        let rows: Vec<_> = conclusions.iter().map(row).collect();
        self.table(&["where", "conclusion", "verdict", "rule", "figures"], &rows);
        self.conclusions = conclusions;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_has_numbers_of_the_paper_and_differences_in_per_cent() {
        let mut page = Page::begin("p", "Title");
        page.item("Table I", "results");
        let one =
            Compared { what: "GP_a", source: "Table I", published: 5.0, here: 5.25, digits: 2 };
        page.compare(&[one]);
        page.picture("p-fig-1", "Look");
        assert!(page.text.contains("### Table I: results"));
        assert!(page.text.contains("| GP_a | Table I | 5 | 5.25 | +5.0 % |"), "{}", page.text);
        assert!(page.text.contains("![Look](p-fig-1.png)") && page.pictures == ["p-fig-1"]);
    }

    #[test]
    fn cells_with_bars_do_not_break_a_table() {
        assert_eq!(table(&["|a|"], &[vec!["1|2".into()]]), "| \\|a\\| |\n| --- |\n| 1\\|2 |\n");
    }
}
