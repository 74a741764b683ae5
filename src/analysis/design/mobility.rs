//! Degrees of freedom of a linkage by counting its links and joints (Kim 2003, Eq 1).
//!
//! `M = D (L - 1) - sum (D - F_i)`: D is 3 in the plane and 6 in space, L counts the ground
//! too, F_i are the freedoms of joint i. More actuators than M are redundant. Counting does
//! not see singular postures or links that happen to be parallel.

/// Mobility of `links` links (the ground is one) whose joints leave `joint_freedoms` each.
pub fn mobility(motion_degree: u32, links: u32, joint_freedoms: &[u32]) -> i64 {
    let D = i64::from(motion_degree);
    let taken: i64 = joint_freedoms.iter().map(|&free| D - i64::from(free)).sum();
    D * (i64::from(links) - 1) - taken
}

/// Links, ground included, and joints of one freedom each of a linkage named as in device files.
pub fn parts_of(mechanism: &str) -> Option<(u32, u32)> {
    match mechanism {
        "two-link" => Some((3, 2)),
        "five-bar" | "symmetric-five-bar" => Some((5, 5)),
        "three-rrr" => Some((8, 9)),
        _ => None,
    }
}

/// Mobility in the plane of a linkage named as in device files.
pub fn mobility_of(mechanism: &str) -> Option<i64> {
    let (links, joints) = parts_of(mechanism)?;
    Some(mobility(3, links, &vec![1; joints as usize]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{BUILT_IN, DeviceDefinition};

    #[test]
    fn the_built_in_linkages_have_the_mobility_that_they_say() {
        for (name, _) in BUILT_IN {
            let mechanism = DeviceDefinition::load(name).unwrap().mechanism;
            let counted = mobility_of(mechanism.name());
            assert_eq!(counted, Some(mechanism.freedoms() as i64), "{name}");
        }
    }

    #[test]
    fn textbook_linkages_have_their_mobility() {
        assert_eq!(mobility(3, 4, &[1; 4]), 1); // four-bar
        assert_eq!(mobility(3, 8, &[1; 9]), 3); // the 3-RRR of Kim 2003
        assert_eq!(mobility(3, 5, &[1; 6]), 0); // a truss
        assert_eq!(mobility(6, 7, &[1; 6]), 6); // an industrial arm
        assert_eq!(mobility(3, 2, &[2]), 2);
    }
}
