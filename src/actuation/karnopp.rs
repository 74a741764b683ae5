//! The passive constraint of one brake: Cho 2005, Eq 1, after Karnopp 1985.
//!
//! As printed, the stick case (Eq 1b) holds even when nothing is commanded to hold with and
//! without any limit; the mended rule holds against the hand with at most the commanded
//! torque.

/// Eq 1 as printed: torque of a brake commanded to `tau_d_Nm`, its shaft turning at `rate`
/// with the hand's torque `tau_h_Nm` on it; up to `stick_rate` it counts as stuck.
pub fn literal_Nm(rate_rad_per_s: f64, tau_d_Nm: f64, tau_h_Nm: f64, stick_rad_per_s: f64) -> f64 {
    if rate_rad_per_s.abs() > stick_rad_per_s {
        slip_Nm(rate_rad_per_s, tau_d_Nm)
    } else if sign(tau_h_Nm) != sign(tau_d_Nm) {
        -tau_h_Nm
    } else {
        0.0
    }
}

/// Eq 1 mended: stuck, it holds against the hand up to `|tau_d_Nm|`.
pub fn limited_Nm(rate_rad_per_s: f64, tau_d_Nm: f64, tau_h_Nm: f64, stick_rad_per_s: f64) -> f64 {
    if rate_rad_per_s.abs() > stick_rad_per_s {
        slip_Nm(rate_rad_per_s, tau_d_Nm)
    } else if sign(tau_h_Nm) != sign(tau_d_Nm) {
        -tau_h_Nm.clamp(-tau_d_Nm.abs(), tau_d_Nm.abs())
    } else {
        0.0
    }
}

/// Eq 1a: against the rate, or nothing.
fn slip_Nm(rate_rad_per_s: f64, tau_d_Nm: f64) -> f64 {
    if sign(rate_rad_per_s) == sign(tau_d_Nm) {
        0.0
    } else {
        -sign(rate_rad_per_s) * tau_d_Nm.abs()
    }
}

/// -1, 0 or 1.
fn sign(value: f64) -> f64 {
    if value > 0.0 {
        1.0
    } else if value < 0.0 {
        -1.0
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mended_brake_never_puts_energy_in_and_keeps_its_limit() {
        for rate in [-2.0, -1e-4, 0.0, 1e-4, 2.0] {
            for tau_d in [-3.0, -0.5, 0.0, 0.5, 3.0] {
                for tau_h in [-5.0, -1.0, 0.0, 1.0, 5.0] {
                    let torque = limited_Nm(rate, tau_d, tau_h, 1e-3);
                    assert!(torque.abs() <= f64::abs(tau_d));
                    assert!(rate.abs() <= 1e-3 || torque * rate <= 0.0);
                    assert!(
                        rate.abs() > 1e-3 || torque * tau_h <= 0.0,
                        "it holds, it does not push"
                    );
                }
            }
        }
    }
}
