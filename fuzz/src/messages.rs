//! Messages that are nearly right, from a script: most fields usual, one now and then not.

use hapticd::proto::{
    self, BoxContact, CapsuleContact, Contact, Contacts, ForceFieldCommand, GuideContact,
    GuideLineContact, GuidePlaneContact, GuidePointContact, HalfSpaceContact, Hello, SphereContact,
    WrenchCommand, command, contact, guide_contact,
};

use crate::script::Script;

/// A client's first message to one of these devices.
pub fn hello(script: &mut Script<'_>, devices: &[&str]) -> Hello {
    let usual = !script.rarely(4);
    let device = format!("devices/{}", script.one_of(devices));
    let role = 1 + i32::from(script.u8() % 3);
    let takeover = role == 2 && script.rarely(2);
    let mut hello = Hello {
        versions: vec!["hapticd/1".to_owned()],
        client_name: "fuzz".to_owned(),
        device,
        role,
        takeover,
        detail: script.rarely(3),
        ..Hello::default()
    };
    if script.rarely(3) {
        hello.command_interval_us = script.number(1_000.0, 50_000.0) as u32;
        hello.state_interval_us = script.number(1_000.0, 1e6) as u32;
        hello.deadband = script.number(0.01, 0.5) as f32;
    }
    if script.rarely(3) {
        let scale = script.number(0.001, 1_000.0) as f32;
        hello.workspace =
            Some(proto::Workspace { scale, offset_m: script.floats(3, -100.0, 100.0) });
    }
    if !usual {
        match script.below(8) {
            0 => hello.versions = vec![script.text(), script.text()],
            1 => hello.client_name = script.text(),
            2 => hello.device = script.text(),
            3 => hello.role = script.u32() as i32,
            4 => hello.takeover = true,
            5 => hello.max_datagram_bytes = script.u32() >> script.below(32),
            6 => hello.command_interval_us = script.u32(),
            _ => hello.state_interval_us = script.u32(),
        }
    }
    hello
}

/// What a controller wants, but for its numbers.
pub fn body(script: &mut Script<'_>) -> Option<command::Body> {
    match script.below(8) {
        0..=3 => {
            let count = if script.rarely(8) { script.below(12) } else { script.below(3) };
            let contacts = (0..count).map(|index| contact(script, index as u32)).collect();
            Some(command::Body::Contacts(Contacts { contacts }))
        }
        4 | 5 => {
            let count = script.one_of(&[3, 6]);
            let wrench = script.floats(count, -20.0, 20.0);
            Some(command::Body::Wrench(WrenchCommand { wrench }))
        }
        6 => {
            let matrix = |script: &mut Script<'_>, most: f64| {
                let count = script.one_of(&[0, 3, 9]);
                script.floats(count, -most, most)
            };
            Some(command::Body::ForceField(ForceFieldCommand {
                origin_m: place(script),
                wrench: script.floats(6, -20.0, 20.0),
                stiffness_n_per_m: matrix(script, 1e4),
                damping_ns_per_m: matrix(script, 1e2),
                radius_m: script.number(0.0, 1.0) as f32,
            }))
        }
        _ => None,
    }
}

/// Near the handle of every device.
fn place(script: &mut Script<'_>) -> Vec<f32> {
    let mut place = script.floats(3, -0.4, 0.4);
    if let Some(z) = place.get_mut(2) {
        *z *= 0.01;
    }
    place
}

fn direction(script: &mut Script<'_>) -> Vec<f32> {
    script.floats(3, -1.0, 1.0)
}

/// One local model.
pub fn contact(script: &mut Script<'_>, index: u32) -> Contact {
    let radius_m = script.number(1e-4, 0.3) as f32;
    let shape = match script.below(8) {
        0 | 1 => contact::Shape::HalfSpace(HalfSpaceContact {
            point_m: place(script),
            normal: direction(script),
        }),
        2 => contact::Shape::Sphere(SphereContact { centre_m: place(script), radius_m }),
        3 => contact::Shape::Box(BoxContact {
            centre_m: place(script),
            half_extents_m: script.floats(3, 1e-4, 0.3),
            orientation: if script.rarely(2) { unit4(script) } else { Vec::new() },
        }),
        4 => {
            let ends_m = [place(script), place(script)].concat();
            contact::Shape::Capsule(CapsuleContact { ends_m, radius_m })
        }
        _ => contact::Shape::Guide(GuideContact {
            radius_m: if script.rarely(2) { 0.0 } else { radius_m },
            path: Some(match script.below(3) {
                0 => guide_contact::Path::Point(GuidePointContact { point_m: place(script) }),
                1 => guide_contact::Path::Line(GuideLineContact {
                    point_m: place(script),
                    direction: direction(script),
                }),
                _ => guide_contact::Path::Plane(GuidePlaneContact {
                    point_m: place(script),
                    normal: direction(script),
                }),
            }),
        }),
    };
    let kinetic_friction = script.number(0.0, 2.0) as f32;
    let stiffest = if script.rarely(2) { 1e9 } else { 2e3 };
    Contact {
        id: if script.rarely(10) { script.u32() } else { index },
        revision: u32::from(script.u8()),
        stiffness_n_per_m: script.number(0.0, stiffest) as f32,
        damping_ns_per_m: script.number(0.0, 100.0) as f32,
        kinetic_friction,
        static_friction: script.rarely(3).then(|| script.number(0.0, 10.0) as f32),
        surface_velocity_m_per_s: if script.rarely(4) {
            script.floats(3, -1.0, 1.0)
        } else {
            Vec::new()
        },
        hollow: script.rarely(4),
        blend_ms: if script.rarely(4) { u32::from(script.u16() % 1_100) } else { 0 },
        shape: (!script.rarely(50)).then_some(shape),
    }
}

fn unit4(script: &mut Script<'_>) -> Vec<f32> {
    let raw = script.floats(4, -1.0, 1.0);
    let length = raw.iter().map(|part| part * part).sum::<f32>().sqrt();
    raw.into_iter().map(|part| part / length).collect()
}
