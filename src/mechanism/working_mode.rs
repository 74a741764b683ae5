//! Working modes: the ways in which the elbows of a linkage can bend.
//!
//! A mode is one sign per elbow, in the order that the linkage states; what a sign means is
//! the linkage's business. Modes of one linkage reach the same places with other postures.
//! Sides of a loop that shafts do not tell apart are assemblies, not modes.

/// Most elbows that a linkage chooses: the chains of the 3-RRR.
const MAX_ELBOWS: usize = 3;

/// One sign per elbow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WorkingMode {
    signs: [i32; MAX_ELBOWS],
    count: usize,
}

impl WorkingMode {
    /// The mode with these signs; more than a linkage can have are cut off.
    pub(super) fn of(signs: &[i32]) -> Self {
        let mut mode = Self { signs: [0; MAX_ELBOWS], count: signs.len().min(MAX_ELBOWS) };
        mode.signs[..mode.count].copy_from_slice(&signs[..mode.count]);
        mode
    }

    /// The signs, one per elbow.
    pub fn as_slice(&self) -> &[i32] {
        &self.signs[..self.count]
    }

    /// Every mode of the linkage that this is one of.
    pub fn all(self) -> impl Iterator<Item = Self> {
        (0..1_usize << self.count).map(move |number| {
            let sign = |i: usize| if number >> i & 1 == 0 { 1 } else { -1 };
            let mut mode = self;
            mode.signs[..self.count].iter_mut().enumerate().for_each(|(i, one)| *one = sign(i));
            mode
        })
    }

    /// The signs of a linkage with `N` elbows; `None`: another linkage's mode.
    pub(super) fn signs<const N: usize>(&self) -> Option<[i32; N]> {
        self.as_slice().try_into().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mechanism::{
        FiveBar, Inertia, Mechanism, SymmetricFiveBar, SymmetricFiveBarParameters, ThreeRrr,
        ThreeRrrParameters, TwoLink, TwoLinkParameters, fixtures,
    };
    use crate::notation::PlaneVector;

    fn linkages() -> [(Box<dyn Mechanism>, PlaneVector); 4] {
        let singh = SymmetricFiveBarParameters {
            a1_m: 0.10,
            a2_m: 0.15,
            a3_m: 0.03,
            s1: 1,
            s2: -1,
            assembly: 1,
        };
        let kim =
            ThreeRrrParameters { base_m: 0.2, l_m: [0.1; 3], turn_rad: 0.5, elbows: [1, -1, 1] };
        let arm = TwoLinkParameters { l1_m: 0.3, l2_m: 0.3, elbow: -1 };
        let place = |x, y, phi| PlaneVector::new(x, y, phi);
        [
            (Box::new(TwoLink::new(arm, Inertia::default()).unwrap()), place(0.3, 0.1, 0.0)),
            (
                Box::new(FiveBar::new(fixtures::CHO[0], Inertia::default()).unwrap()),
                place(0.3, 0.1, 0.0),
            ),
            (
                Box::new(SymmetricFiveBar::new(singh, Inertia::default()).unwrap()),
                place(0.02, 0.14, 0.0),
            ),
            (Box::new(ThreeRrr::new(kim, Inertia::default()).unwrap()), place(0.01, 0.02, 0.1)),
        ]
    }

    #[test]
    fn every_mode_puts_the_handle_at_the_same_place_with_another_posture() {
        for (device, p_BH) in linkages() {
            let own = device.working_mode();
            assert!(own.all().any(|mode| mode == own), "{}", device.name());
            let mut seen = Vec::new();
            for mode in own.all() {
                let other = device.in_working_mode(&mode).expect("its own elbows");
                assert_eq!(other.working_mode(), mode);
                let posture = other.posture_at(&p_BH).expect("regular in every mode");
                assert!((posture.p_BH.xy() - p_BH.xy()).norm() < 1e-12);
                assert!(seen.iter().all(|shafts: &crate::notation::ActuatorVector| {
                    (shafts - posture.shaft_rad).norm() > 1e-3
                }));
                seen.push(posture.shaft_rad);
            }
            assert_eq!(seen.len(), 1 << own.as_slice().len());
        }
    }

    #[test]
    fn a_mode_of_another_linkage_is_none_of_this_one() {
        let devices = linkages();
        assert!(devices[0].0.in_working_mode(&devices[3].0.working_mode()).is_none());
        assert!(devices[3].0.in_working_mode(&WorkingMode::default()).is_none());
    }
}
