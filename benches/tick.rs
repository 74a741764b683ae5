//! Time of one tick, device input and output aside: promise 2 of SPECIFICATION.
//!
//! Each row is a run of the simulated `cho-2005`; the plant lives between the ticks, outside
//! the measured time, and only ticks in the state that the row names are counted. The unit is
//! one posture from shaft angles, measured after each of these ticks.

#![allow(non_snake_case)]

mod experiment;
mod measure;

use std::time::{Duration, Instant};

use experiment::{Experiment, WALL_X_M, plane, scene, wall, wall_contact};
use hapticd::control::Report;
use hapticd::device::{CircleProgram, HandProgram, SlideProgram};
use hapticd::environment::{Element, Material, Shape, Surface};
use measure::{Series, clock_alone, print_table, rounds};
use nalgebra::Vector3;

/// Faster is sliding, slower is rest, m/s.
const AT_REST_M_PER_S: f64 = 1e-3;

/// Real time between ticks of the paced row.
const PERIOD: Duration = Duration::from_millis(1);

/// Times that each run is made: it goes the same way every time.
const RUNS: usize = 5;

/// Every so many objects there is a copy of the wall: more surfaces touched than are kept.
const WALLS_APART: usize = 8;

fn main() {
    let slide = HandProgram::default();
    let circle = HandProgram::Circle(CircleProgram::default());
    // Presses against the wall and never starts along it.
    let press = HandProgram::PressAndSlide(SlideProgram {
        slide_m_per_s: 0.0,
        give_up_s: f64::INFINITY,
        ..SlideProgram::default()
    });
    let contacts = [wall_contact()];
    let one = || Experiment::new(slide, scene([]), &contacts);
    let many = |count| Experiment::new(slide, scene(objects(count)), &[]);
    let soft = [Element::Surface(wall(0.3)), Element::ViscousField { damping_Ns_per_m: 5.0 }];

    let mut unit = Series::new("one posture from shafts");
    let ticks = rounds(40_000);
    let mut run = |name: &str, start: &dyn Fn() -> Experiment, counts: fn(&Report) -> bool| {
        measured(name, start, ticks, counts, &mut unit)
    };
    let rows = [
        run("free air", &|| Experiment::new(circle, scene([]), &[]), in_free_air),
        run("one wall, at rest", &|| Experiment::new(press, scene([]), &contacts), at_rest),
        run("one wall, sliding", &one, sliding),
        run(
            "one wall with friction, viscous field",
            &|| Experiment::new(slide, scene(soft.clone()), &[]),
            sliding,
        ),
        run("64 objects, 8 walls touched, sliding", &|| many(64), sliding),
        run("256 objects, 32 walls touched, sliding", &|| many(256), sliding),
    ];
    let paced = paced("one wall, sliding, woken at 1 kHz", one(), rounds(12_000), sliding);
    let clock = clock_alone();
    let rows = rows.iter().flatten().chain([&paced, &unit, &clock]);
    print_table("one tick of cho-2005", &unit, rows);
    for name in ["kim-2003", "singh", "singh-brakes", "two-link"] {
        let mut unit = Series::new("one posture from shafts");
        let demo = || Experiment::demo_of(name);
        let rows = [
            measured("free air", &demo, ticks, in_free_air, &mut unit),
            measured("its wall", &demo, ticks, touching, &mut unit),
        ];
        let rows = rows.iter().flatten().chain([&unit, &clock]);
        print_table(&format!("one tick of {name}"), &unit, rows);
    }
}

/// The ticks that count of the same run, several times over: all of them, and of each its
/// fastest, which shows what the law takes where the machine does not interfere.
fn measured(
    name: &str,
    start: &dyn Fn() -> Experiment,
    ticks: usize,
    counts: fn(&Report) -> bool,
    unit: &mut Series,
) -> [Series; 2] {
    let mut series = Series::new(name);
    let mut best = vec![None; ticks];
    for _ in 0..RUNS {
        let mut experiment = start();
        for best in &mut best {
            let step = experiment.step();
            if counts(&step.report) {
                series.record(step.took);
                unit.record(step.posture);
                *best = Some(best.map_or(step.took, |best| step.took.min(best)));
            }
        }
    }
    let mut undisturbed = Series::new(format!("  each tick at its best of {RUNS}"));
    best.into_iter().flatten().for_each(|took| undisturbed.record(took));
    // two-link is free for the first half second of its run only.
    assert!(undisturbed.len() > ticks as u64 / 100, "{name}: {} ticks", undisturbed.len());
    [series, undisturbed]
}

/// The same with a sleep before each tick, as the loop's thread has it: caches and the
/// processor's clock have had time to cool.
fn paced(
    name: &str,
    mut experiment: Experiment,
    ticks: usize,
    counts: fn(&Report) -> bool,
) -> Series {
    let mut series = Series::new(name);
    let mut due = Instant::now();
    for _ in 0..ticks {
        due += PERIOD;
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let step = experiment.step();
        if counts(&step.report) {
            series.record(step.took);
        }
    }
    series
}

fn in_free_air(report: &Report) -> bool {
    report.contact_count == 0
}

fn touching(report: &Report) -> bool {
    report.contact_count > 0
}

fn at_rest(report: &Report) -> bool {
    report.contact_count > 0 && report.v_WT_m_per_s.norm() < AT_REST_M_PER_S
}

fn sliding(report: &Report) -> bool {
    report.contact_count > 0 && report.v_WT_m_per_s.norm() >= AT_REST_M_PER_S
}

/// Walls, some of them in one place, and spheres that stand behind it.
fn objects(count: usize) -> Vec<Element> {
    let wall_at = |x_m| plane(Vector3::new(x_m, 0.0, 0.0), -Vector3::x(), 0.0);
    let ball = |i: usize| Surface {
        shape: Shape::Sphere {
            centre_W_m: Vector3::new(0.4 + 0.001 * i as f64, 0.1, 0.0),
            radius_m: 0.02,
        },
        material: Material { stiffness_N_per_m: 1000.0, ..Material::default() },
        hollow: i.is_multiple_of(3),
        blend_s: 0.0,
    };
    let surface = |i: usize| match i % WALLS_APART {
        0 => wall_at(WALL_X_M),
        1..4 => wall_at(0.5 + 0.001 * i as f64),
        _ => ball(i),
    };
    (0..count).map(|i| Element::Surface(surface(i))).collect()
}
