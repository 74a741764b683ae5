//! The three papers beside hapticd: their own values, ours, and a verdict on each conclusion.
//!
//! | file | what |
//! |---|---|
//! | [`page`] | a page in Markdown, and what a published value is beside ours |
//! | [`verdict`] | conclusions of a paper with rules that figures can turn |
//! | [`cho`] | Cho, Song & Kim 2005: the braked five-bar |
//! | [`kim`] | Kim, Chung, Yi & Suh 2003: the redundant 3-RRR |
//! | [`singh`] | Singh, Saha & Manivannan: the symmetric five-bar |
//!
//! For each paper `measure` computes figures, `conclusions` judges them, and `page` writes the
//! page from both; the pages name pictures, which whoever writes the files draws. Published
//! values are typed in with the place where the paper has them. A page depends on code and seed
//! alone: no date, no duration, no machine. It knows no file.

pub mod cho;
pub mod kim;
pub mod page;
pub mod singh;
pub mod verdict;

pub use page::{Compared, Page};
pub use verdict::{Conclusion, Verdict};

/// Names of the tables and figures of a paper, in its order, as the headings of its page.
pub fn items(page: &str) -> Vec<String> {
    let figures = |from: u32, to: u32| (from..=to).map(|number| format!("Figure {number}"));
    match page {
        "cho-2005" => {
            let before = figures(1, 8).chain(["Table I".to_owned()]);
            before.chain(figures(9, 15)).collect()
        }
        "kim-2003" => figures(1, 8).collect(),
        "singh" => figures(1, 5).chain(["Table 1".to_owned()]).chain(figures(6, 10)).collect(),
        _ => Vec::new(),
    }
}

/// The index of the pages, in ten lines.
pub fn index(pages: &[Page]) -> String {
    let mut text = String::from(
        "# The three papers beside hapticd\n\n\
         Written by `hapticd experiment papers`: every figure on these pages is computed by that run.\n\n\
         | page | paper | conclusions: confirmed / in part / not / not testable |\n|---|---|---|\n",
    );
    for page in pages {
        let count = |verdict| page.conclusions.iter().filter(|one| one.verdict == verdict).count();
        let counts = Verdict::ALL.map(count).map(|count| count.to_string()).join(" / ");
        text += &format!("| [{0}.md]({0}.md) | {1} | {counts} |\n", page.name, page.title);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_paper_has_its_tables_and_figures_in_its_order() {
        let names = |page| items(page).join(", ");
        assert_eq!(items("cho-2005").len(), 16);
        assert!(names("cho-2005").contains("Figure 8, Table I, Figure 9"));
        assert!(names("singh").contains("Figure 5, Table 1, Figure 6"));
        assert_eq!(items("kim-2003").len(), 8);
    }

    #[test]
    fn the_index_has_ten_lines_at_most_and_counts_verdicts() {
        let mut page = Page::begin("singh", "S");
        page.judge(vec![Conclusion::not_testable("Abstract", "it is good", "hardware")]);
        let text = index(&[page.clone(), page.clone(), page]);
        assert!(text.lines().count() <= 10, "{text}");
        assert!(text.contains("| [singh.md](singh.md) | S | 0 / 0 / 0 / 1 |"), "{text}");
    }
}
