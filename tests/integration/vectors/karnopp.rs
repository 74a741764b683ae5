//! `karnopp.json`: the passive constraint of one brake, as printed and as mended.

use hapticd::actuation::{limited_Nm, literal_Nm};

use super::cases;

#[test]
fn every_karnopp_case_agrees() {
    for case in cases("karnopp") {
        let rate = case.number("qdot");
        let (tau_d, tau_h) = (case.number("tau_d"), case.number("tau_h"));
        let stick = case.number("dv");
        case.expect("literal", &[literal_Nm(rate, tau_d, tau_h, stick)]);
        case.expect("limited", &[limited_Nm(rate, tau_d, tau_h, stick)]);
    }
}
