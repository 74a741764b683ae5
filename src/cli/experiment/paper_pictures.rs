//! The pictures of the papers' pages, each under the name by which its page shows it.
//!
//! Where a study of its own draws a figure already, that one is taken.

mod cho;

pub use cho::cho;

use super::force_distribution::{
    condition_picture, push_picture, resolution_picture, torque_picture,
};
use super::synthesis::{
    axes, borders_picture, chain, classes_picture, direct_picture, ellipses_picture, search_picture,
};
use crate::analysis::experiment::force_distribution::{Rig, pushed_pose};
use crate::analysis::papers::kim::Kim;
use crate::analysis::papers::singh::{OPTIMUM, Singh};
use crate::cli::design::linkage;
use crate::config::DeviceDefinition;
use crate::mechanism::Mechanism;
use crate::notation::PlaneVector;
use crate::plot::{Axis, Colour, Figure, Legend, Marks, Panel, Series, Sign};

/// Pictures by name, without an ending.
pub type Pictures = Vec<(&'static str, Figure)>;

/// Those of Kim et al. 2003.
pub fn kim(found: &Kim) -> anyhow::Result<Pictures> {
    let rig = Rig::new(&found.study)?;
    Ok(vec![
        ("kim-2003-fig-1", three_rrr()?),
        ("kim-2003-fig-2-3", push_picture(&found.pushes)),
        ("kim-2003-fig-4-7", torque_picture(&found.pushes[0], found.study.limits_Nm[1])),
        ("kim-2003-conditions", condition_picture(&rig)),
        ("kim-2003-resolution", resolution_picture(&found.resolutions)),
    ])
}

/// The linkage in the pose of the push.
fn three_rrr() -> anyhow::Result<Figure> {
    let device = DeviceDefinition::load("kim-2003")?;
    let posture = device.mechanism.posture_at(&pushed_pose())?;
    let motors = |names: &[usize]| -> Vec<[f64; 2]> {
        let mut outline = Default::default();
        let count = device.mechanism.outline(&posture, &mut outline);
        // Of each chain: base to elbow, elbow to plate, a side of the plate.
        let starts = outline[..count].iter().map(|(from, _)| *from).enumerate();
        starts.filter(|(i, _)| names.contains(i)).map(|(_, at)| at).collect()
    };
    let panel = Panel {
        title: "3-RRR in the pose of the push".into(),
        x: Axis::between("x [m]", -0.24, 0.24),
        y: Axis::new("y [m]"),
        equal: true,
        legend: Legend::UpperRight,
        series: vec![
            Series::new("links and plate", Colour::Black, linkage(&device, &posture)),
            Series::new(
                "base motors",
                Colour::Blue,
                Marks::Points(Sign::Square, motors(&[0, 3, 6])),
            ),
            Series::new(
                "floating motors",
                Colour::Vermilion,
                Marks::Points(Sign::Circle, motors(&[1, 4, 7])),
            ),
        ],
    };
    Ok(Figure { panel_px: (560, 500), ..Figure::single(panel) })
}

/// Those of Singh et al.
pub fn singh(found: &Singh) -> anyhow::Result<Pictures> {
    let optimum = OPTIMUM.linkage(0.01)?;
    Ok(vec![
        ("singh-fig-1", five_bar()?),
        ("singh-fig-2", borders_picture()),
        ("singh-fig-3", direct_picture()),
        ("singh-fig-4", combined()),
        ("singh-fig-5", classes_picture()),
        ("singh-fig-6-7", search_picture(&found.found)),
        ("singh-fig-8-9", ellipses_picture(&optimum)),
    ])
}

/// Figure 1: the linkage with its names.
fn five_bar() -> anyhow::Result<Figure> {
    let optimum = OPTIMUM.linkage(0.01)?;
    let posture = optimum.posture_at(&PlaneVector::new(0.04, 0.16, 0.0))?;
    let joint = |i: usize, side: f64| {
        let (sin, cos) = posture.shaft_rad[i].sin_cos();
        [side * OPTIMUM.a3 + OPTIMUM.a1 * cos, OPTIMUM.a1 * sin]
    };
    let joints = [[-3.0, 0.0], joint(0, -1.0), [4.0, 16.0], joint(1, 1.0), [3.0, 0.0]];
    let mut panel = axes("The symmetric five-bar, (10, 15, 3)");
    panel.series.extend(chain(joints).map(|series| Series { label: None, ..series }));
    let names = ["O1", "B1", "C", "B2", "O2"];
    let words = joints.iter().zip(names).map(|([x, y], name)| {
        let beside = if name.ends_with('1') { -1.5 } else { 0.5 };
        ([x + beside, y + 0.9], name.to_owned())
    });
    // Names of links stand outside of the loop.
    let middle = |a: usize, b: usize, name: &str| {
        let [dx, dy] = [0, 1].map(|k| joints[b][k] - joints[a][k]);
        let length = dx.hypot(dy);
        let at = [0, 1].map(|k| 0.5 * (joints[a][k] + joints[b][k]));
        ([at[0] - 0.9 * dy / length - 0.4, at[1] + 0.9 * dx / length + 0.3], name.to_owned())
    };
    let lengths = [(0, 1, "a1"), (1, 2, "a2"), (2, 3, "a2"), (3, 4, "a1")];
    let words = words.chain(lengths.map(|(a, b, name)| middle(a, b, name)));
    panel.series.push(Series::unnamed(Colour::Blue, Marks::Text(words.collect())));
    panel.x = Axis::between("x [cm]", -15.0, 15.0);
    panel.y = Axis::between("y [cm]", -2.0, 20.0);
    Ok(Figure { panel_px: (560, 460), ..Figure::single(panel) })
}

/// Figure 4: a design with r2 = r3, its driven links parallel; and a chain along the base.
fn combined() -> Figure {
    let (sin, cos) = 70f64.to_radians().sin_cos();
    let (x, y) = (8.0 * cos, 8.0 * sin);
    let mut parallel = axes("a2 = a3: (8, 5, 5), driven links parallel");
    parallel.series.extend(chain([[-5.0, 0.0], [x - 5.0, y], [x, y], [x + 5.0, y], [5.0, 0.0]]));
    let free = Marks::Arrows(vec![[[x, y], [x, y + 3.0]], [[x, y], [x, y - 3.0]]]);
    parallel.series.push(Series::new("C is free this way", Colour::Vermilion, free));
    let mut along = axes("a3 = a1 + a2: (4, 5, 9), all along the base");
    along.series.extend(chain([[-9.0, 0.0], [-5.0, 0.0], [0.0, 0.0], [5.0, 0.0], [9.0, 0.0]]));
    let free = Marks::Arrows(vec![[[0.0, 0.0], [0.0, 3.0]], [[0.0, 0.0], [0.0, -3.0]]]);
    along.series.push(Series::new("C is free this way", Colour::Vermilion, free));
    for panel in [&mut parallel, &mut along] {
        panel.legend = Legend::UpperLeft;
        panel.x = Axis::between("x [cm]", -12.0, 12.0);
        panel.y = Axis::between("y [cm]", -7.0, 17.0);
    }
    Figure { columns: 2, panel_px: (460, 440), panels: vec![parallel, along], title: String::new() }
}
