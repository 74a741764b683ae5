//! Pictures that a paper could print, as data: panels with axes, and what is drawn in them.
//!
//! Whoever has something to show fills a [`Figure`] and saves it as `.svg` or `.png`; nothing
//! else in hapticd knows how a line is drawn. Numbers that are not finite are gaps. Colours
//! are those of Okabe and Ito, which people tell apart however they see them; a map's are
//! viridis, light for large. The font is in the program: a picture is the same everywhere.

mod draw;
mod range;
mod sign;

use std::path::{Path, PathBuf};

/// One picture of one or several panels, row by row.
#[derive(Clone, Debug, Default)]
pub struct Figure {
    /// Above all panels; may be empty.
    pub title: String,
    /// Panels beside each other.
    pub columns: usize,
    /// Width and height of a panel in pixels of the SVG; a PNG has twice as many.
    pub panel_px: (u32, u32),
    /// What there is to see.
    pub panels: Vec<Panel>,
}

/// One pair of axes.
#[derive(Clone, Debug, Default)]
pub struct Panel {
    /// Above the axes; may be empty.
    pub title: String,
    /// Across.
    pub x: Axis,
    /// Up.
    pub y: Axis,
    /// A unit is as long across as up: for places and directions.
    pub equal: bool,
    /// Where the names of the series stand.
    pub legend: Legend,
    /// From the back to the front.
    pub series: Vec<Series>,
}

/// An axis with its unit.
#[derive(Clone, Debug, Default)]
pub struct Axis {
    /// For instance `x [m]`.
    pub label: String,
    /// What is shown; `None`: all that there is, and a little air.
    pub range: Option<[f64; 2]>,
    /// By powers of ten; what is not positive is a gap.
    pub logarithmic: bool,
}

impl Axis {
    /// An axis that shows all that there is.
    pub fn new(label: impl Into<String>) -> Self {
        Self { label: label.into(), ..Self::default() }
    }

    /// An axis from here to there.
    pub fn between(label: impl Into<String>, from: f64, to: f64) -> Self {
        Self { range: Some([from, to]), ..Self::new(label) }
    }

    /// An axis of powers of ten.
    pub fn logarithmic(label: impl Into<String>) -> Self {
        Self { logarithmic: true, ..Self::new(label) }
    }
}

/// A corner for the names of the series.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[expect(missing_docs, reason = "a corner is a corner")]
pub enum Legend {
    #[default]
    UpperRight,
    UpperLeft,
    LowerRight,
    LowerLeft,
}

/// Marks of one kind.
#[derive(Clone, Debug)]
pub struct Series {
    /// Its name in the legend; `None`: it has none.
    pub label: Option<String>,
    /// Not read for [`Marks::Cells`].
    pub colour: Colour,
    /// What is drawn.
    pub marks: Marks,
}

impl Series {
    /// Marks that the legend names.
    pub fn new(label: impl Into<String>, colour: Colour, marks: Marks) -> Self {
        Self { label: Some(label.into()), colour, marks }
    }

    /// Marks without a name.
    pub fn unnamed(colour: Colour, marks: Marks) -> Self {
        Self { label: None, colour, marks }
    }
}

/// What can be drawn; places are in the units of the axes.
#[derive(Clone, Debug)]
pub enum Marks {
    /// Through these points.
    Line(Vec<[f64; 2]>),
    /// The same, thinner and with gaps.
    Dashed(Vec<[f64; 2]>),
    /// A sign at each point.
    Points(Sign, Vec<[f64; 2]>),
    /// From the first place to the second, with a head.
    Arrows(Vec<[[f64; 2]; 2]>),
    /// An outline, closed, and the area in it a little tinted.
    Area(Vec<[f64; 2]>),
    /// A bar from each edge to the next, of these heights.
    Bars(Vec<f64>, Vec<f64>),
    /// Rectangles coloured by value, with a bar that explains the colours.
    Cells {
        /// Lower left and upper right corner, and the value.
        cells: Vec<([f64; 2], [f64; 2], f64)>,
        /// Of the values, with their unit.
        label: String,
        /// Values of the darkest and the lightest colour; `None`: of all that there are.
        range: Option<[f64; 2]>,
        /// Colours by powers of ten.
        logarithmic: bool,
    },
    /// Words, their left end at a place.
    Text(Vec<([f64; 2], String)>),
}

/// A sign that marks a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "signs speak for themselves")]
pub enum Sign {
    Dot,
    Circle,
    Cross,
    Plus,
    Asterisk,
    Square,
    Diamond,
}

/// Colours of Okabe and Ito (2008), and greys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "names of colours")]
pub enum Colour {
    Black,
    Orange,
    SkyBlue,
    Green,
    Yellow,
    Blue,
    Vermilion,
    Purple,
    Grey,
    LightGrey,
}

impl Colour {
    /// For series that are only to be told apart.
    pub const CYCLE: [Self; 7] = [
        Self::Blue,
        Self::Vermilion,
        Self::Green,
        Self::Purple,
        Self::Orange,
        Self::SkyBlue,
        Self::Black,
    ];

    /// The colour of the series with this number.
    pub fn of(number: usize) -> Self {
        Self::CYCLE[number % Self::CYCLE.len()]
    }
}

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The name does not say what kind of picture is wanted.
    #[error("{}: a picture's name must end in .svg or .png", path.display())]
    Kind {
        /// The name.
        path: PathBuf,
    },
    /// It could not be written.
    #[error("{}: {reason}", path.display())]
    Write {
        /// Where to.
        path: PathBuf,
        /// What went wrong.
        reason: String,
    },
    /// It could not be drawn.
    #[error("the picture cannot be drawn: {0}")]
    Draw(String),
}

impl Figure {
    /// A picture of one panel.
    pub fn single(panel: Panel) -> Self {
        Self { title: String::new(), columns: 1, panel_px: (640, 480), panels: vec![panel] }
    }

    /// The picture as SVG.
    pub fn svg(&self) -> Result<String, PictureError> {
        draw::svg(self)
    }

    /// Writes the picture; the name's ending, `.svg` or `.png`, tells as what.
    pub fn save(&self, path: &Path) -> Result<(), PictureError> {
        let write = |reason: String| PictureError::Write { path: path.to_owned(), reason };
        match path.extension().and_then(|extension| extension.to_str()) {
            Some("svg") => {
                std::fs::write(path, self.svg()?).map_err(|error| write(error.to_string()))
            }
            Some("png") => {
                // The library that draws tells too little of a file that cannot be made.
                std::fs::File::create(path).map_err(|error| write(error.to_string()))?;
                draw::png(self, path)
            }
            _ => Err(PictureError::Kind { path: path.to_owned() }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn everything() -> Figure {
        let wave = (0..100).map(|k| 0.1 * f64::from(k)).map(|x| [x, x.sin()]).collect::<Vec<_>>();
        let square = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let cells = (0..4).map(f64::from).map(|x| ([x, 2.0], [x + 1.0, 3.0], 10f64.powf(x)));
        let drawn = vec![
            Series::new("wave < & >", Colour::Blue, Marks::Line(wave.clone())),
            Series::new("again", Colour::Vermilion, Marks::Dashed(wave)),
            Series::unnamed(Colour::Grey, Marks::Area(square.clone())),
            Series::new("corners", Colour::Green, Marks::Points(Sign::Diamond, square)),
            Series::new("arrow", Colour::Black, Marks::Arrows(vec![[[2.0, 0.0], [4.0, 0.5]]])),
            Series::unnamed(Colour::Black, Marks::Text(vec![([5.0, 0.5], "here".to_owned())])),
        ];
        let map = Marks::Cells {
            cells: cells.collect(),
            label: "K [1]".to_owned(),
            range: None,
            logarithmic: true,
        };
        let panel = |title: &str, series| Panel {
            title: title.to_owned(),
            x: Axis::new("x [m]"),
            y: Axis::new("y [m]"),
            series,
            ..Panel::default()
        };
        Figure {
            title: "Everything".to_owned(),
            columns: 2,
            panel_px: (420, 320),
            panels: vec![
                panel("marks", drawn),
                Panel { equal: true, ..panel("a map", vec![Series::unnamed(Colour::Black, map)]) },
                panel(
                    "bars",
                    vec![Series::new(
                        "share",
                        Colour::SkyBlue,
                        Marks::Bars(vec![0.0, 1.0, 2.0, 3.0], vec![3.0, 5.0, 1.0]),
                    )],
                ),
            ],
        }
    }

    #[test]
    fn every_label_is_in_the_svg_and_none_breaks_it() {
        let svg = everything().svg().unwrap();
        for words in ["Everything", "x [m]", "y [m]", "K [1]", "corners", "here", "a map"] {
            assert!(svg.contains(words), "{words}");
        }
        assert!(svg.contains("wave &lt; &amp; &gt;") && !svg.contains("wave < &"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        // Finer than whole pixels.
        let sizes: Vec<f64> = (svg.split('"').take(6))
            .flat_map(|word| word.split(' ').filter_map(|number| number.parse().ok()))
            .collect();
        let [width, height, 0.0, 0.0, across, down] = sizes[..] else { panic!("{sizes:?}") };
        assert_eq!((across / width, down / height), (8.0, 8.0));
    }

    #[test]
    fn gaps_and_nothing_at_all_can_be_drawn() {
        let gaps = vec![[0.0, f64::NAN], [1.0, 1.0], [f64::INFINITY, 2.0], [2.0, 2.0], [3.0, 1.0]];
        for points in [gaps, vec![], vec![[1.0, 1.0]]] {
            for logarithmic in [false, true] {
                let axis = Axis { logarithmic, ..Axis::new("x") };
                let series = vec![Series::new("line", Colour::Blue, Marks::Line(points.clone()))];
                let panel = Panel { x: axis.clone(), y: axis, series, ..Panel::default() };
                let svg = Figure::single(panel).svg().unwrap();
                assert!(!svg.contains("NaN") && svg.contains("line"));
            }
        }
    }

    #[test]
    fn the_ending_tells_the_kind_and_a_wrong_one_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        for (name, begins) in [("a.svg", &b"<svg"[..]), ("a.png", &b"\x89PNG"[..])] {
            let path = folder.path().join(name);
            everything().save(&path).unwrap();
            assert!(std::fs::read(&path).unwrap().starts_with(begins), "{name}");
        }
        let error = everything().save(Path::new("picture.pdf")).unwrap_err().to_string();
        assert_eq!(error, "picture.pdf: a picture's name must end in .svg or .png");
        let nowhere = folder.path().join("no/such/folder/a.png");
        let error = everything().save(&nowhere).unwrap_err().to_string();
        assert!(error.contains("folder/a.png") && error.contains("No such"), "{error}");
    }
}
