//! `hapticd design optimize`: better lengths and ratios within bounds.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::{Map, Value, json};

use super::arguments::{Output, Workspace, parse_pair, progress_bar, write};
use super::found_file::{device_file, parse_path};
use super::{pictures, synthesis};
use crate::analysis::design::Grid;
use crate::analysis::design::linkages::{DesignBounds, NAMES, five_bar_of, variables_of};
use crate::analysis::design::optimise::{Design, DesignProblem, Effort, Method, optimise, pareto};
use crate::config::DeviceDefinition;
use crate::mechanism::FiveBarParameters;
use crate::plot::{Axis, Colour, Figure, Marks, Panel, Series, Sign};

/// How to search.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SearchMethod {
    /// Nelder and Mead with exterior penalties, as published
    Simplex,
    /// Particle swarms, then Nelder and Mead
    Global,
}

/// Search for better lengths and ratios
///
/// A braked five-bar: the weighted sum of GP_a and GP_f over the area-uniform workspace is made
/// small. Links 1 to 4 and the ratios k3 and k4 vary within their bounds; link 5 stays what the
/// device has, because only the lengths over it matter for directions (Cho 2005, Eq 18), and so
/// do the signs: lever, tendons, elbow, branch. A symmetric five-bar: the places with K of 5 or
/// more are counted for every design of Singh's Table 1.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd design optimize --device cho-2005 --seed 1 --json
  hapticd design optimize --device cho-2005-crossed --write better.toml
  hapticd design optimize --method simplex --weights 1,1 --starts 16
  hapticd design optimize --pareto --out front.svg --csv front.csv
  hapticd design optimize --l 0.1,0.35 --k 0.2,1 --r 0.15,0.5

The result depends on the seed and not on the number of threads.")]
pub struct Optimize {
    /// Built-in device or device file: what is varied, and what stays
    #[arg(long, value_name = "NAME|FILE", default_value = "cho-2005")]
    device: String,
    /// How to search; without it global
    #[arg(long, value_enum)]
    method: Option<SearchMethod>,
    /// Of the random starts; without it 1
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Independent random starts, 1 to 1000; without it 12
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    starts: Option<u16>,
    /// Weights of GP_a and GP_f in the utility function; without it 1,10
    #[arg(long, value_name = "A,F", value_parser = parse_pair)]
    weights: Option<[f64; 2]>,
    /// Least and most length of links 1 to 4, m; without it 0.1,0.3
    #[arg(long, value_name = "LEAST,MOST", value_parser = parse_pair)]
    l: Option<[f64; 2]>,
    /// Least and most of the ratios k3 and k4; without it 0.1,1
    #[arg(long, value_name = "LEAST,MOST", value_parser = parse_pair)]
    k: Option<[f64; 2]>,
    /// Search the front between GP_a alone and GP_f alone too, by so many weightings
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "9",
        value_parser = clap::value_parser!(u16).range(2..=100))]
    pareto: Option<u16>,
    /// Write the design as a device file that `serve` takes
    #[arg(long, value_name = "FILE", value_parser = parse_path)]
    write: Option<PathBuf>,
    #[command(flatten)]
    workspace: Workspace,
    #[command(flatten)]
    output: Output,
}

impl Optimize {
    /// Searches, prints, and writes.
    pub fn run(self) -> anyhow::Result<()> {
        let device = DeviceDefinition::load(&self.device)?;
        if device.mechanism.name() == "symmetric-five-bar" {
            if let Some(option) = self.options().next() {
                anyhow::bail!(
                    "{option}: a symmetric-five-bar is searched whole, by its one count; it has \
                     nothing to set"
                );
            }
            return synthesis::run(&device, &self.output, self.write.as_deref());
        }
        let Some(class) = five_bar_of(&device.parameters) else {
            anyhow::bail!(
                "{}: a {} has no known design problem; five-bar and symmetric-five-bar have",
                device.name,
                device.mechanism.name()
            );
        };
        self.workspace.check_round("the mean that is made small", "nothing")?;
        self.workspace.phi_rad(&device)?;
        let problem = self.problem(class)?;
        let effort = self.effort();
        let rounds = u64::from(self.starts()) * (1 + self.pareto.map_or(0, u64::from));
        let bar = progress_bar(rounds, "starts");
        let found = optimise(&problem, &effort, &|| bar.inc(1));
        let front =
            self.pareto.map(|steps| pareto(&problem, &effort, steps.into(), &|| bar.inc(1)));
        bar.finish_and_clear();
        let Some(found) = found else {
            let [least_m, most_m] = problem.workspace_m;
            anyhow::bail!(
                "no design within these bounds reaches r = {least_m} to {most_m} m; widen --l or \
                 narrow --r"
            );
        };
        let given = problem.evaluate(&variables_of(&class));
        let outcome = Outcome { device: &device, problem, found, given, front };
        if self.output.json {
            say!("{}", outcome.json(&self));
        } else {
            outcome.print();
        }
        self.output.table(|| csv(outcome.front.as_deref().unwrap_or(&[found])))?;
        self.output.picture(|| outcome.picture())?;
        match &self.write {
            Some(path) => write(path, &file_of(&device, &found)?),
            None => Ok(()),
        }
    }

    fn problem(&self, class: FiveBarParameters) -> anyhow::Result<DesignProblem> {
        let bounds =
            DesignBounds { l_m: self.l.unwrap_or([0.1, 0.3]), k: self.k.unwrap_or([0.1, 1.0]) };
        bounds.check()?;
        let [a, f] = self.weights.unwrap_or([1.0, 10.0]);
        anyhow::ensure!(
            (0.0..=1e3).contains(&a) && (0.0..=1e3).contains(&f) && a + f >= 1e-3,
            "--weights {a},{f}: must be 0 to 1000 each, and not both 0"
        );
        let problem =
            DesignProblem { class, bounds, workspace_m: self.workspace.radii_m(), weights: [a, f] };
        problem.grid().check()?;
        Ok(problem)
    }

    fn effort(&self) -> Effort {
        let method = match self.method() {
            SearchMethod::Simplex => Method::Simplex,
            SearchMethod::Global => Method::Global,
        };
        Effort { method, starts: self.starts().into(), radii: 31, seed: self.seed() }
    }

    fn method(&self) -> SearchMethod {
        self.method.unwrap_or(SearchMethod::Global)
    }

    fn seed(&self) -> u64 {
        self.seed.unwrap_or(1)
    }

    fn starts(&self) -> u16 {
        self.starts.unwrap_or(12)
    }

    /// What was given of how to search, by name.
    fn options(&self) -> impl Iterator<Item = &'static str> {
        let all = [
            ("--method", self.method.is_some()),
            ("--seed", self.seed.is_some()),
            ("--starts", self.starts.is_some()),
            ("--weights", self.weights.is_some()),
            ("--l", self.l.is_some()),
            ("--k", self.k.is_some()),
            ("--pareto", self.pareto.is_some()),
        ];
        let given = all.into_iter().filter(|(_, given)| *given).map(|(name, _)| name);
        given.chain(self.workspace.given())
    }
}

/// What came of a search.
struct Outcome<'a> {
    device: &'a DeviceDefinition,
    problem: DesignProblem,
    found: Design,
    /// The device's own design, where it reaches the workspace.
    given: Option<Design>,
    /// Where one was asked for.
    front: Option<Vec<Design>>,
}

impl Outcome<'_> {
    fn json(&self, search: &Optimize) -> Value {
        let Self { device, problem, found, given, front } = self;
        let mut all = design_json(found);
        let mut put = |key: &str, value| drop(all.insert(key.into(), value));
        put("device", json!(device.name.as_str()));
        put("method", json!(format!("{:?}", search.method()).to_lowercase()));
        put("seed", json!(search.seed()));
        put("starts", json!(search.starts()));
        put("weights", json!({ "gp_a": problem.weights[0], "gp_f": problem.weights[1] }));
        put("utility", json!(problem.utility(found)));
        put(
            "bounds",
            json!({ "l_m": problem.bounds.l_m, "k": problem.bounds.k,
            "r_m": problem.workspace_m, "l5_m": problem.class.l_m[4] }),
        );
        put("grid", json!(Grid::Annulus(problem.grid()).to_string()));
        put("given", json!(given.as_ref().map(design_json)));
        if let Some(front) = front {
            put("pareto", front.iter().map(design_json).collect::<Vec<_>>().into());
        }
        all.into()
    }

    fn print(&self) {
        let Self { device, problem, found, given, front } = self;
        let ([a, f], [l_least, l_most], [k_least, k_most]) =
            (problem.weights, problem.bounds.l_m, problem.bounds.k);
        say!("grid: {}", Grid::Annulus(problem.grid()));
        say!(
            "made small: {a} GP_a + {f} GP_f; links 1 to 4 {l_least} to {l_most} m, ratios \
             {k_least} to {k_most}, link 5 stays {} m",
            problem.class.l_m[4]
        );
        if let Some(given) = given {
            say!("{:<10} {}", device.name, line(given));
        }
        say!("{:<10} {}", "found", line(found));
        for design in front.iter().flatten() {
            say!("{:<10} {}", "front", line(design));
        }
    }

    /// The front where there is one, otherwise the histograms before and after.
    fn picture(&self) -> Figure {
        let name = self.device.name.as_str();
        if let Some(front) = &self.front {
            let given = self.given.map(|design| (name, design));
            return Figure::single(front_panel(front, &[("found", self.found)], given));
        }
        let grid = Grid::Annulus(self.problem.grid());
        let betas = |design: &Design| {
            let linkage = crate::analysis::design::linkages::build(&design.parameters).ok()?;
            Some(pictures::largest_betas_deg(&linkage, &grid))
        };
        let designs = [(name, self.given), ("found", Some(self.found))];
        let all: Vec<_> = (designs.into_iter())
            .filter_map(|(name, design)| Some((name, betas(&design?)?)))
            .collect();
        Figure::single(pictures::histogram("Largest beta over the workspace", &all))
    }
}

fn line(design: &Design) -> String {
    let FiveBarParameters { l_m, k3, k4, .. } = design.parameters;
    let l_m: Vec<_> = l_m.iter().map(|l| format!("{l:.4}")).collect();
    format!(
        "GP_a {:.4}  GP_f {:.4}  l {} m  k3 {k3:.4}  k4 {k4:.4}",
        design.GP_a,
        design.GP_f,
        l_m.join(" ")
    )
}

fn design_json(design: &Design) -> Map<String, Value> {
    let FiveBarParameters { l_m, k3, k4, lever, tendons, elbow, branch } = design.parameters;
    let parameters = json!({ "l_m": l_m, "k3": k3, "k4": k4, "lever": lever, "tendons": tendons,
        "elbow": elbow, "branch": branch });
    let pairs =
        [("gp_a", json!(design.GP_a)), ("gp_f", json!(design.GP_f)), ("design", parameters)];
    pairs.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
}

fn csv(designs: &[Design]) -> String {
    let line = |design: &Design| {
        let variables = variables_of(&design.parameters).map(|value| value.to_string());
        format!(
            "{},{},{},{}\n",
            design.GP_a,
            design.GP_f,
            variables.join(","),
            design.parameters.l_m[4]
        )
    };
    let lines: String = designs.iter().map(line).collect();
    format!("gp_a,gp_f,{},l5_m\n{lines}", NAMES.join(","))
}

/// Mean P_f over mean P_a: a front, and designs beside it.
pub fn front_panel(
    front: &[Design],
    others: &[(&str, Design)],
    given: Option<(&str, Design)>,
) -> Panel {
    let at = |design: &Design| [design.GP_a, design.GP_f];
    let points: Vec<_> = front.iter().map(at).collect();
    let mut series = vec![
        Series::unnamed(Colour::Blue, Marks::Line(points.clone())),
        Series::new("front, by weighted sums", Colour::Blue, Marks::Points(Sign::Dot, points)),
    ];
    let beside = given.iter().chain(others).map(|(_, design)| design);
    let signs = [Sign::Diamond, Sign::Square, Sign::Circle, Sign::Cross];
    for (i, (name, design)) in given.iter().chain(others).enumerate() {
        let marks = Marks::Points(signs[i % signs.len()], vec![at(design)]);
        series.push(Series::new(*name, Colour::of(i + 1), marks));
    }
    Panel {
        title: "Mean indices over the area-uniform workspace".into(),
        x: Axis::new("GP_a [rad^2]"),
        y: with_headroom("GP_f [rad]", front.iter().chain(beside).map(|design| design.GP_f)),
        series,
        ..Panel::default()
    }
}

/// An axis that leaves room for a legend above all values.
fn with_headroom(label: &str, values: impl Iterator<Item = f64>) -> Axis {
    let (least, most) =
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), v| (l.min(v), m.max(v)));
    let span = (most - least).max(1e-6);
    Axis::between(label, least - 0.05 * span, most + 0.35 * span)
}

/// The given device with the found lengths and ratios.
fn file_of(device: &DeviceDefinition, found: &Design) -> anyhow::Result<String> {
    let Design { parameters: FiveBarParameters { l_m, k3, k4, .. }, GP_a, GP_f } = *found;
    let comment = format!(
        "# A five-bar found by `hapticd design optimize` from {}: mean indices over the\n# \
         area-uniform workspace GP_a = {GP_a}, GP_f = {GP_f}.",
        device.name
    );
    let description =
        format!("Five-bar found from {} (GP_a {GP_a:.4}, GP_f {GP_f:.4})", device.name);
    let values = [("l_m", l_m.to_vec().into()), ("k3", k3.into()), ("k4", k4.into())];
    device_file(device, &comment, Some(description), values)
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        search: Optimize,
    }

    /// A symmetric five-bar has its one search: nothing that was asked is passed over.
    #[test]
    fn what_a_search_does_not_take_is_refused_by_name() {
        for (device, option, value) in [
            ("singh", "--method", "simplex"),
            ("singh", "--seed", "1"),
            ("singh", "--starts", "12"),
            ("singh", "--weights", "1,10"),
            ("singh", "--l", "0.1,0.3"),
            ("singh", "--k", "0.1,1"),
            ("singh", "--pareto", "9"),
            ("singh", "--r", "0.2,0.5"),
            ("singh", "--phi", "5"),
            ("cho-2005", "--x", "0,0.1"),
            ("cho-2005", "--step", "0.1"),
            ("cho-2005", "--phi", "5"),
        ] {
            let words = ["optimize", "--device", device, option, value];
            let error = Line::parse_from(words).search.run().unwrap_err().to_string();
            assert!(error.starts_with(&format!("{option}:")), "{option}: {error}");
        }
    }

    #[test]
    fn a_found_design_is_a_device_that_can_be_loaded() {
        let device = DeviceDefinition::load("cho-2005-crossed").unwrap();
        let mut parameters = five_bar_of(&device.parameters).unwrap();
        (parameters.l_m[1], parameters.k3) = (0.181, 0.3333);
        let found = Design { parameters, GP_a: 5.0, GP_f: 0.9 };
        let text = file_of(&device, &found).unwrap();
        let read = DeviceDefinition::from_toml("mine", &text, "mine.toml").unwrap();
        assert_eq!(five_bar_of(&read.parameters), Some(parameters));
        assert_eq!(read.actuators, device.actuators);
        assert!(read.description.contains("found from cho-2005-crossed"), "{}", read.description);
    }
}
