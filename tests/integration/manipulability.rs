//! GetManipulability over real gRPC and on the command line.

use std::f64::consts::TAU;

use hapticd::proto::{GetManipulabilityRequest, Region, Vector3};
use tonic::Code;

use super::support::{DEVICE, Rig, run};

fn at(x: f64, y: f64, motion_rad: Option<f64>) -> GetManipulabilityRequest {
    let handle_m = Some(Vector3 { x, y, z: 0.0 });
    GetManipulabilityRequest { name: DEVICE.into(), handle_m, motion_rad, directions: 0 }
}

#[test]
fn a_place_has_its_forces_and_regions_and_nonsense_is_refused() {
    let rig = Rig::start();
    rig.run(async {
        let mut devices = rig.services().await.devices;
        let moving = devices.get_manipulability(at(0.3, 0.1, Some(0.0))).await.unwrap();
        let moving = moving.into_inner();
        assert_eq!((moving.reference_forces.len(), moving.largest.len()), (4, 36));
        assert_eq!(moving.reference_forces[3].actuator, "brake-4");
        assert!(moving.condition >= 1.0 && moving.p_a.unwrap() > 4.9);
        let turn_rad: f64 = moving.sectors.iter().map(|s| s.to_rad - s.from_rad).sum();
        assert!((turn_rad - TAU).abs() < 1e-9);
        // Along the motion brakes give nothing, against it they do.
        let along = |rad: f64| moving.largest.iter().find(|f| (f.angle_rad - rad).abs() < 1e-6);
        assert_eq!(along(0.0).unwrap().now_n, 0.0);
        assert!(along(TAU / 2.0).unwrap().now_n > 10.0);
        assert!(moving.sectors.iter().any(|s| s.region() == Region::NotDisplayable));
        let resting = devices.get_manipulability(at(0.3, 0.1, None)).await.unwrap().into_inner();
        assert!(resting.sectors.is_empty() && resting.largest[0].now_n > 10.0);
        let here = GetManipulabilityRequest { name: DEVICE.into(), ..Default::default() };
        devices.get_manipulability(here).await.unwrap();
        let many = GetManipulabilityRequest { directions: 361, ..at(0.3, 0.1, None) };
        for (request, said) in [
            (at(9.0, 0.0, None), "handle_m = (9, 0) m"),
            (at(f64::NAN, 0.0, None), "handle_m.x = NaN"),
            (at(0.3, 0.1, Some(f64::INFINITY)), "motion_rad = inf"),
            (many, "directions = 361"),
        ] {
            let refused = devices.get_manipulability(request).await.unwrap_err();
            assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");
            assert!(refused.message().contains(said), "{refused}");
        }
    });
    let connect = rig.target().to_string();
    let ctl = |arguments: &[&str]| {
        let whole = [&["ctl", "manipulability", "--connect", &connect], arguments].concat();
        run(&whole)
    };
    let shown = ctl(&["--at", "0.3,0.1", "--motion", "90"]).ok().stdout;
    assert!(shown.contains("handle at (0.3000, 0.1000) m, moving to 90.0 deg"), "{shown}");
    assert!(shown.contains("not-displayable") && shown.contains("brake-4"), "{shown}");
    let json = ctl(&["--at", "0.3,-0.1", "--directions", "8", "--json"]).ok().stdout;
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["largest"].as_array().unwrap().len(), 8);
    ctl(&["--at", "0.3"]).refused(&["two numbers"]);
}
