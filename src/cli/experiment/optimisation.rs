//! `hapticd experiment optimisation`: Cho 2005, section 6, done again and gone beyond.
//!
//! Table I beside our means with every grid named, Figures 9 and 10, the published method from
//! the published start, a global search over the same class, the front between the two means,
//! and the same with crossed tendons. Nothing is tuned to fit a published number.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::report::Report;
use crate::analysis::design::grid::CHO_WORKSPACE_M;
use crate::analysis::design::linkages::{five_bar_of, variables_of};
use crate::analysis::design::optimise::{
    Design, DesignProblem, Effort, Method, optimise, pareto, simplex_from, undominated,
};
use crate::analysis::design::{Annulus, GlobalIndices, Grid};
use crate::cli::design::{circles, fan, front_panel, histogram, largest_betas_deg, progress_bar};
use crate::config::DeviceDefinition;
use crate::mechanism::{FiveBarParameters, Mechanism};
use crate::notation::{ActuatorVector, PlaneVector};
use crate::plot::{Axis, Colour, Figure, Legend, Marks, Panel, Series};

/// Weights of GP_a and GP_f that are tried; the paper does not state its own.
const WEIGHTS: [[f64; 2]; 5] = [[1.0, 0.0], [1.0, 1.0], [1.0, 4.0], [1.0, 10.0], [0.0, 1.0]];

/// What Table I prints: GP_a, GP_f, smallest and largest beta in degrees.
const PUBLISHED: [(&str, [f64; 4]); 2] = [
    ("cho-2005-unoptimised", [7.509, 1.614, 4.0, 112.9]),
    ("cho-2005", [5.310, 1.035, 21.1, 79.7]),
];

/// Places of the paper.
const PUBLISHED_PLACES: f64 = 3813.0;

/// Cho 2005, section 6: Table I, Figures 9 and 10, and better designs
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd experiment optimisation --out optimisation
  hapticd experiment optimisation --out optimisation --seed 7 --starts 24 --json")]
pub struct Optimisation {
    /// Folder for report.md and the pictures
    #[arg(long, value_name = "DIR", default_value = "optimisation")]
    out: PathBuf,
    /// Of the random starts
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Independent starts of each search, 1 to 1000
    #[arg(long, value_name = "N", default_value_t = 8,
        value_parser = clap::value_parser!(u16).range(1..=1000))]
    starts: u16,
    /// Print the figures as one JSON object, and nothing else, on stdout
    #[arg(long)]
    json: bool,
}

/// A device of the paper.
pub(super) struct Published {
    device: DeviceDefinition,
    parameters: FiveBarParameters,
    printed: [f64; 4],
}

/// What the searches found within one class.
struct Found {
    simplex: Vec<([f64; 2], Option<Design>)>,
    global: Vec<([f64; 2], Option<Design>)>,
    front: Vec<Design>,
}

impl Optimisation {
    /// Searches, draws, and writes the report.
    pub fn run(self) -> anyhow::Result<()> {
        let mut report =
            Report::begin(&self.out, "Optimisation of the braked five-bar (Cho 2005, section 6)")?;
        let published = published()?;
        table_1(&mut report, &published);
        report.heading("Figure 9");
        report.picture(
            "figure-9",
            "Largest angle between neighbouring rays, before and after the optimisation.",
            &histograms(&published),
        )?;
        report.heading("Figure 10");
        report.picture(
            "figure-10",
            "Directions of the reference forces of the optimised device: each sector between two \
             of them is a region.",
            &rays_over_workspace(&published[1]),
        )?;
        let start = published[0].parameters;
        let straight = self.search(published[1].parameters, start);
        let crossed_class = crossed()?;
        let crossed = self.search(crossed_class, FiveBarParameters { tendons: -1, ..start });
        self.methods(&mut report, &published[1], &straight);
        self.fronts(&mut report, &published[1], &straight, &crossed)?;
        conclusions(&mut report, &straight, &crossed);
        let path = report.finish()?;
        if self.json {
            let listed = |found: &Found| {
                found.front.iter().map(|d| json!([d.GP_a, d.GP_f])).collect::<Vec<_>>()
            };
            say!(
                "{}",
                json!({ "report": path.display().to_string(), "seed": self.seed,
                "front": listed(&straight), "front_crossed": listed(&crossed) })
            );
        } else {
            say!("{}", path.display());
        }
        Ok(())
    }

    fn search(&self, class: FiveBarParameters, start: FiveBarParameters) -> Found {
        let effort = Effort {
            method: Method::Global,
            starts: self.starts.into(),
            radii: 31,
            seed: self.seed,
        };
        let steps = 9;
        let what = if class.tendons > 0 { "straight tendons" } else { "crossed tendons" };
        let bar = progress_bar(u64::from(self.starts) * (WEIGHTS.len() as u64 + steps), what);
        let problem = |weights| DesignProblem::published(class, weights);
        let simplex =
            WEIGHTS.map(|w| (w, simplex_from(&problem(w), &start, effort.radii))).to_vec();
        let global = WEIGHTS.map(|w| (w, optimise(&problem(w), &effort, &|| bar.inc(1)))).to_vec();
        let mut front = pareto(&problem([1.0, 1.0]), &effort, steps as usize, &|| bar.inc(1));
        front.extend(global.iter().filter_map(|(_, design)| *design));
        bar.finish_and_clear();
        Found { simplex, global, front: undominated(front) }
    }

    fn methods(&self, report: &mut Report, published: &Published, found: &Found) {
        report.heading("The published method and a global one");
        report.say(&format!(
            "Utility function w_a GP_a + w_f GP_f over the area-uniform mean, l1 to l4 in [0.1, \
             0.3] m, k3 and k4 in [0.1, 1], l5 = 0.3 m (Eq 18 normalises by it). *Simplex*: \
             Nelder and Mead with exterior penalties from the paper's start (all links 0.3 m, \
             ratios 0.1). *Global*: particle swarms and Nelder and Mead from {} random starts, \
             seed {}. The paper does not state its weights; five are tried.",
            self.starts, self.seed
        ));
        let head = ["weights a : f", "method", "GP_a", "GP_f", "l1 l2 l3 l4 [m]", "k3", "k4"];
        let printed = DesignProblem::published(published.parameters, [1.0, 1.0])
            .evaluate(&variables_of(&published.parameters));
        let mut rows = vec![row("not stated", "as published", printed.as_ref())];
        for (method, designs) in [("simplex", &found.simplex), ("global", &found.global)] {
            for ([a, f], design) in designs {
                rows.push(row(&format!("{a} : {f}"), method, design.as_ref()));
            }
        }
        report.table(&head, &rows);
        let cost = |[a, f]: [f64; 2], design: &Design| a * design.GP_a + f * design.GP_f;
        let both = found.simplex.iter().zip(&found.global);
        let behind = both.filter_map(|((weights, local), (_, global))| {
            Some(100.0 * (cost(*weights, local.as_ref()?) / cost(*weights, global.as_ref()?) - 1.0))
        });
        let all: Vec<Design> =
            found.simplex.iter().chain(&found.global).filter_map(|(_, design)| *design).collect();
        let beats = |one: &&Design| {
            printed.is_some_and(|printed| one.GP_a < printed.GP_a && one.GP_f < printed.GP_f)
        };
        let beating = all.iter().filter(beats).count();
        report.say(&format!(
            "At equal weights the simplex method from the paper's start ends at most {:.2} % \
             behind the global one. {beating} of the {count} designs are better than the published \
             one in both means.",
            behind.fold(0.0, f64::max),
            count = all.len()
        ));
    }

    fn fronts(
        &self,
        report: &mut Report,
        published: &Published,
        straight: &Found,
        crossed: &Found,
    ) -> anyhow::Result<()> {
        report.heading("The front between the two means");
        let given = DesignProblem::published(published.parameters, [1.0, 1.0])
            .evaluate(&variables_of(&published.parameters));
        let figure = front_picture(&straight.front, &crossed.front, given);
        report.picture(
            "pareto",
            "Mean P_f over mean P_a of the best designs, by weighted sums.",
            &figure,
        )?;
        let head = ["tendons", "GP_a", "GP_f", "l1 l2 l3 l4 [m]", "k3", "k4"];
        let mut rows = Vec::new();
        for (name, found) in [("straight", straight), ("crossed", crossed)] {
            rows.extend(found.front.iter().map(|design| row("", name, Some(design)).split_off(1)));
        }
        report.table(&head, &rows);
        Ok(())
    }
}

/// Both devices of the paper, the unoptimised one first.
pub(super) fn published() -> anyhow::Result<Vec<Published>> {
    PUBLISHED
        .iter()
        .map(|(name, printed)| {
            let device = DeviceDefinition::load(name)?;
            let parameters = five_bar_of(&device.parameters)
                .ok_or_else(|| anyhow::anyhow!("{name} is no five-bar"))?;
            Ok(Published { device, parameters, printed: *printed })
        })
        .collect()
}

/// The fronts of both classes, and the published design beside its own.
pub(super) fn front_picture(
    straight: &[Design],
    crossed: &[Design],
    published: Option<Design>,
) -> Figure {
    let given = published.map(|design| ("Cho 2005, optimised", design));
    let mut wide = front_panel(straight, &[], given);
    wide.title = "Straight tendons (the published class)".into();
    let mut narrow = front_panel(crossed, &[], None);
    narrow.title = "Crossed tendons".into();
    Figure { columns: 2, panel_px: (480, 400), panels: vec![wide, narrow], title: String::new() }
}

fn crossed() -> anyhow::Result<FiveBarParameters> {
    let device = DeviceDefinition::load("cho-2005-crossed")?;
    five_bar_of(&device.parameters)
        .ok_or_else(|| anyhow::anyhow!("cho-2005-crossed is no five-bar"))
}

fn grids() -> [(&'static str, Grid); 3] {
    let [a, b] = CHO_WORKSPACE_M;
    [
        ("area-uniform", Grid::Annulus(Annulus::area(a, b))),
        ("polar 31 x 123", Grid::Annulus(Annulus::polar(a, b))),
        ("radial", Grid::Annulus(Annulus::radial(a, b))),
    ]
}

fn over(mechanism: &dyn Mechanism, grid: &Grid) -> GlobalIndices {
    GlobalIndices::over(mechanism, &ActuatorVector::repeat(20.0), grid)
}

fn table_1(report: &mut Report, published: &[Published]) {
    report.heading("Table I");
    let head = [
        "device",
        "source",
        "GP_a [rad^2]",
        "GP_f [rad]",
        "smallest beta [deg]",
        "largest beta [deg]",
        "places with largest beta 50 to 60 deg",
    ];
    let mut rows = Vec::new();
    for Published { device, printed: [a, f, least, most], .. } in published {
        let optimised = device.name.as_str() == "cho-2005";
        let told = if optimised { "\"almost 2500\" of 3813" } else { "-" };
        rows.push(vec![
            device.name.to_string(),
            "paper (grid not stated)".into(),
            format!("{a:.3}"),
            format!("{f:.3}"),
            format!("{least:.1}"),
            format!("{most:.1}"),
            told.into(),
        ]);
        for (name, grid) in grids() {
            let found = over(device.mechanism.as_ref(), &grid);
            let [least, most] = found.beta_rad.map(f64::to_degrees);
            rows.push(vec![
                device.name.to_string(),
                format!("here, {name}"),
                format!("{:.3}", found.GP_a),
                format!("{:.3}", found.GP_f),
                format!("{least:.2}"),
                format!("{most:.2}"),
                format!(
                    "{:.0} of 3813 ({:.1} %)",
                    PUBLISHED_PLACES * found.share_50_60,
                    100.0 * found.share_50_60
                ),
            ]);
        }
    }
    report.table(&head, &rows);
    report.say("The grids:");
    report.say(&grids().map(|(_, grid)| format!("* {grid}")).join("\n"));
    report.say(
        "The extremes are those of the paper, so the geometry is the same. The means and the \
         share are not, under any of these grids: the paper does not say where its 3813 places \
         lie.",
    );
}

/// Figure 9: the histogram under two grids.
pub(super) fn histograms(published: &[Published]) -> Figure {
    let panels = grids().into_iter().take(2).map(|(name, grid)| {
        let betas = published.iter().map(|one| {
            let label =
                if one.device.name.as_str() == "cho-2005" { "optimised" } else { "unoptimised" };
            (label, largest_betas_deg(one.device.mechanism.as_ref(), &grid))
        });
        let mut panel = histogram(name, &betas.collect::<Vec<_>>());
        panel.legend = Legend::UpperRight;
        panel
    });
    Figure { columns: 2, panel_px: (480, 380), panels: panels.collect(), title: String::new() }
}

/// Figure 10: the rays over the workspace, and a part enlarged.
pub(super) fn rays_over_workspace(published: &Published) -> Figure {
    let [least_m, most_m] = CHO_WORKSPACE_M;
    let sparse =
        Grid::Annulus(Annulus { radii: 6, bearings: 24, ..Annulus::polar(least_m, most_m) });
    let whole: Vec<PlaneVector> = sparse.places().map(|place| place.p_BH).collect();
    let near = (0..4).flat_map(|i| (0..4).map(move |j| (i, j)));
    let near: Vec<_> = near
        .map(|(i, j)| PlaneVector::new(0.22 + 0.04 * f64::from(i), 0.02 + 0.04 * f64::from(j), 0.0))
        .collect();
    let mut left = rays_panel(published, &whole, 0.022);
    left.title = "whole workspace".into();
    left.series.push(Series::unnamed(Colour::LightGrey, circles(CHO_WORKSPACE_M)));
    let corners = vec![[0.2, 0.0], [0.36, 0.0], [0.36, 0.16], [0.2, 0.16], [0.2, 0.0]];
    left.series.push(Series::new("enlarged", Colour::Black, Marks::Dashed(corners)));
    let mut right = rays_panel(published, &near, 0.018);
    right.title = "enlarged".into();
    Figure { columns: 2, panel_px: (560, 540), panels: vec![left, right], title: String::new() }
}

fn rays_panel(published: &Published, places: &[PlaneVector], half_m: f64) -> Panel {
    let mechanism = published.device.mechanism.as_ref();
    let of_brake = |brake: usize| {
        let lines = places.iter().filter_map(|place| {
            let posture = mechanism.posture_at(place).ok()?;
            Some(fan(&posture.reference, brake, [place.x, place.y], half_m))
        });
        let colour = Colour::of(brake);
        Series::new(format!("R{}", brake + 1), colour, Marks::Line(lines.flatten().collect()))
    };
    Panel {
        x: Axis::new("x [m]"),
        y: Axis::new("y [m]"),
        equal: true,
        legend: Legend::LowerRight,
        series: (0..mechanism.actuators()).map(of_brake).collect(),
        ..Panel::default()
    }
}

fn row(weights: &str, method: &str, design: Option<&Design>) -> Vec<String> {
    let Some(design) = design else {
        let mut cells = vec![weights.to_owned(), method.to_owned()];
        cells.extend(["none reaches the workspace", "-", "-", "-", "-"].map(str::to_owned));
        return cells;
    };
    let FiveBarParameters { l_m, k3, k4, .. } = design.parameters;
    let lengths: Vec<_> = l_m[..4].iter().map(|l| format!("{l:.4}")).collect();
    vec![
        weights.into(),
        method.into(),
        format!("{:.4}", design.GP_a),
        format!("{:.4}", design.GP_f),
        lengths.join(" "),
        format!("{k3:.4}"),
        format!("{k4:.4}"),
    ]
}

fn conclusions(report: &mut Report, straight: &Found, crossed: &Found) {
    report.heading("What follows");
    let ends = |found: &Found| Some((*found.front.first()?, *found.front.last()?));
    let (Some((a, f)), Some((ca, cf))) = (ends(straight), ends(crossed)) else { return };
    let better = if ca.GP_f.max(cf.GP_f) < f.GP_f && ca.GP_a.max(cf.GP_a) < a.GP_a {
        ": any of them is better in both means than any straight one"
    } else {
        ""
    };
    report.say(&format!(
        "* In the published class the least GP_a is {:.4} (with GP_f {:.4}) and the least GP_f \
         {:.4} (with GP_a {:.4}).\n\
         * With crossed tendons the front goes from GP_a {:.4} (GP_f {:.4}) to GP_f {:.4} (GP_a \
         {:.4}){better}.\n\
         * P_a and P_f see directions only. How strong a reference force is, and how far its brake \
         must turn, has to be looked at beside them (`hapticd design compare`).",
        a.GP_a, a.GP_f, f.GP_f, f.GP_a, ca.GP_a, ca.GP_f, cf.GP_f, cf.GP_a
    ));
}
