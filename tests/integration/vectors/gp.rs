//! `gp.json`: betas and indices of the three designs by radius, and their named means.

use hapticd::analysis::design::{Annulus, GlobalIndices, Grid, Mean};
use hapticd::mechanism::{FiveBar, Mechanism, Rays};
use hapticd::notation::{ActuatorVector, PlaneVector};

use super::fivebar::device;
use super::{Case, cases};

#[test]
fn every_gp_case_agrees() {
    for case in cases("gp") {
        let device = device(&case);
        check_radii(&case, &device);
        check_means(&case, &device);
    }
}

fn check_radii(case: &Case, device: &FiveBar) {
    let (mut betas, mut P_a, mut P_f) = (Vec::new(), Vec::new(), Vec::new());
    for r_m in case.numbers("r") {
        let posture = device.posture_at(&PlaneVector::new(r_m, 0.0, 0.0));
        let posture = posture.unwrap_or_else(|e| panic!("{}: {e}", case.place("r")));
        let rays = Rays::of(&posture.reference, 4).expect("rays");
        betas.extend_from_slice(&rays.betas_rad()[..4]);
        P_a.push(rays.P_a());
        P_f.push(rays.P_f());
    }
    case.expect("betas", &betas);
    case.expect("P_a", &P_a);
    case.expect("P_f", &P_f);
}

fn check_means(case: &Case, device: &FiveBar) {
    let over = |annulus| {
        GlobalIndices::over(device, &ActuatorVector::repeat(20.0), &Grid::Annulus(annulus))
    };
    let area = over(Annulus::area(0.2, 0.5));
    let polar = over(Annulus::polar(0.2, 0.5));
    let radial = over(Annulus::radial(0.2, 0.5));
    assert_eq!(Annulus::radial(0.2, 0.5).mean, Mean::Radial);
    case.expect("GPa_area", &[area.GP_a]);
    case.expect("GPf_area", &[area.GP_f]);
    case.expect("GPa_polar31", &[polar.GP_a]);
    case.expect("GPf_polar31", &[polar.GP_f]);
    case.expect("GPa_radial", &[radial.GP_a]);
    case.expect("GPf_radial", &[radial.GP_f]);
    case.expect("frac_50_60_area", &[area.share_50_60]);
    case.expect("frac_50_60_polar31", &[polar.share_50_60]);
    case.expect("beta_min_deg", &[area.beta_rad[0].to_degrees()]);
    case.expect("beta_max_deg", &[area.beta_rad[1].to_degrees()]);
}
