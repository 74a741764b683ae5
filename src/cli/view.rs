//! What a demo shows while it runs: a picture of the device on a terminal, plain lines else.
// Names carry frames: `p_W_m`, `v_B`.

use std::time::{Duration, Instant};

use nalgebra::Vector3;
use ratatui::Frame;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyModifiers};
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::canvas::{Canvas, Context, Line as Stroke};
use ratatui::widgets::{Block, Paragraph};

use super::format;
use crate::app::{Daemon, RunningDevice};
use crate::config::{DemoWall, DeviceDefinition};
use crate::control::{Limit, Mount, RenderedSource, Report};
use crate::mechanism::Outline;
use crate::proto;
use crate::telemetry::RunFigures;

/// Pictures per second: smooth to the eye, nothing to a processor.
const FRAME: Duration = Duration::from_millis(50);

/// Length that one newton has in the picture.
const M_PER_N: f64 = 0.004;

/// Longest arrow in the picture.
const LONGEST_M: f64 = 0.25;

/// Called between pictures; an error ends the view.
type Check<'a> = &'a mut dyn FnMut() -> anyhow::Result<()>;

/// Draws until `until`, q, Ctrl-C, SIGTERM or a failed check.
pub fn live(
    daemon: &mut Daemon,
    wall: &DemoWall,
    until: Option<Instant>,
    check: Check,
) -> anyhow::Result<()> {
    let mut terminal = ratatui::try_init()?;
    let result = (|| loop {
        check()?;
        let device = &daemon.devices()[0];
        let (report, figures) = (device.host().report(), device.figures());
        terminal.draw(|frame| draw(frame, daemon, device, wall, &report, &figures))?;
        let over = until.is_some_and(|until| Instant::now() >= until);
        if over || quit_pressed()? || daemon.wait_for_signal(Some(Instant::now())) {
            return Ok(());
        }
    })();
    ratatui::restore();
    result
}

/// Waits for a frame's time; true when the user wants to leave.
fn quit_pressed() -> anyhow::Result<bool> {
    if !event::poll(FRAME)? {
        return Ok(false);
    }
    Ok(match event::read()? {
        Event::Key(key) => {
            let interrupt =
                key.modifiers.contains(KeyModifiers::CONTROL) && key.code == KeyCode::Char('c');
            interrupt || matches!(key.code, KeyCode::Char('q') | KeyCode::Esc)
        }
        _ => false,
    })
}

/// One line a second until `until`, Ctrl-C, SIGTERM or a failed check.
pub fn plain(
    daemon: &mut Daemon,
    until: Option<Instant>,
    tell: &dyn Fn(String),
    check: Check,
) -> anyhow::Result<()> {
    loop {
        let second = Instant::now() + Duration::from_secs(1);
        let next = until.map_or(second, |until| until.min(second));
        if daemon.wait_for_signal(Some(next)) {
            return Ok(());
        }
        check()?;
        let device = &daemon.devices()[0];
        tell(line(&device.host().report(), &device.figures()));
        if until.is_some_and(|until| Instant::now() >= until) {
            return Ok(());
        }
    }
}

fn line(report: &Report, figures: &RunFigures) -> String {
    format!(
        "tick {:>7}  x {:.4} y {:+.4} m  hand {:>7}  {:<16} wakeup p99 {:>5.0} us  next-tick {}{}",
        report.tick,
        report.p_WT_m.x,
        report.p_WT_m.y,
        report.hand.map_or("unknown".into(), |hand| format!("{:.1} N", hand.force_N.norm())),
        region_word(report),
        figures.wakeup_p99_us,
        percent(figures.command_lag_one_ratio),
        if report.stuck { "  STUCK" } else { "" },
    )
}

fn percent(share: Option<f64>) -> String {
    share.map_or("-".into(), |share| format!("{:.2} %", share * 100.0))
}

fn region_word(report: &Report) -> String {
    report.region.map_or("-".into(), |region| format::word(region.name(), ""))
}

fn draw(
    frame: &mut Frame,
    daemon: &Daemon,
    device: &RunningDevice,
    wall: &DemoWall,
    report: &Report,
    figures: &RunFigures,
) {
    let [picture, side] =
        Layout::horizontal([Constraint::Min(40), Constraint::Length(44)]).areas(frame.area());
    let mount = device.host().settings().settings.mount;
    let device = device.host().definition();
    draw_device(frame, picture, device, wall, &mount, report);
    let [forces, brakes, latency] = Layout::vertical([
        Constraint::Length(13),
        Constraint::Length(3 + device.actuator_names.len() as u16),
        Constraint::Min(11),
    ])
    .areas(side);
    frame.render_widget(forces_panel(report), forces);
    let names = device.actuator_names.iter().map(|name| name.as_str());
    let most_Nm = device.actuators.max_torque_Nm.as_slice();
    frame.render_widget(brakes_panel(report, names, most_Nm), brakes);
    frame.render_widget(latency_panel(daemon, figures), latency);
}

fn draw_device(
    frame: &mut Frame,
    area: Rect,
    device: &DeviceDefinition,
    wall: &DemoWall,
    mount: &Mount,
    report: &Report,
) {
    let mechanism = device.mechanism.as_ref();
    let plane = Plane(mount);
    let tool_m = plane.point(&report.p_WT_m);
    let reach_m = mechanism.reach_m().1.max(0.1);
    // Cells are about twice as high as wide; keep a metre a metre.
    let height_m = 1.1 * reach_m;
    let aspect = f64::from(area.width) / (2.0 * f64::from(area.height).max(1.0));
    let width_m = height_m * aspect;
    let centre_m = [0.3 * reach_m, 0.1 * reach_m];
    let paint = |canvas: &mut Context| {
        draw_wall(canvas, &plane, wall, reach_m);
        if let Ok(posture) = mechanism.posture_at(&report.p_BH) {
            let mut segments = Outline::default();
            let count = mechanism.outline(&posture, &mut segments);
            for (from, to) in &segments[..count] {
                canvas.draw(&Stroke::new(from[0], from[1], to[0], to[1], Color::Gray));
            }
        }
        let mut arrow = |force_N, color| {
            let [x, y] = plane.vector(force_N);
            let scale = M_PER_N.min(LONGEST_M / x.hypot(y).max(1e-9));
            let end = [tool_m[0] + scale * x, tool_m[1] + scale * y];
            canvas.draw(&Stroke::new(tool_m[0], tool_m[1], end[0], end[1], color));
        };
        arrow(&report.requested.force_N, Color::Blue);
        arrow(&report.achievable.force_N, Color::Yellow);
        if let Some(hand) = report.hand {
            arrow(&hand.force_N, Color::Red);
        }
        canvas.print(report.p_BH.x, report.p_BH.y, "●".white().bold());
        canvas.print(0.0, 0.0, "◎".white());
    };
    let legend = Line::from(vec![
        Span::styled(" hand ", Style::new().red()),
        Span::styled(" asked ", Style::new().blue()),
        Span::styled(" chosen ", Style::new().yellow()),
        Span::styled(" wall ", Style::new().cyan()),
        Span::raw(" q quits "),
    ]);
    let canvas = Canvas::default()
        .block(Block::bordered().title(format!(" {} ", mechanism.name())).title_bottom(legend))
        .marker(Marker::Braille)
        .x_bounds([centre_m[0] - width_m, centre_m[0] + width_m])
        .y_bounds([centre_m[1] - height_m, centre_m[1] + height_m])
        .paint(paint);
    frame.render_widget(canvas, area);
}

/// The device's plane, in which everything is drawn; forces, tool and wall are known in W.
struct Plane<'a>(&'a Mount);

impl Plane<'_> {
    fn point(&self, p_W_m: &Vector3<f64>) -> [f64; 2] {
        self.vector(&(p_W_m - self.0.p_WB_m))
    }

    fn vector(&self, v_W: &Vector3<f64>) -> [f64; 2] {
        let v_B = self.0.q_WB.inverse_transform_vector(v_W);
        [v_B.x, v_B.y]
    }

    /// Where the plane cuts `normal_W . p = offset_m`, drawn so long; `None` where it does not.
    fn cut(&self, normal_W: &Vector3<f64>, offset_m: f64, long_m: f64) -> Option<[[f64; 2]; 2]> {
        let [x, y] = self.vector(normal_W);
        let length = x.hypot(y);
        if length < 1e-6 {
            return None;
        }
        let away_m = (offset_m - normal_W.dot(&self.0.p_WB_m)) / length;
        let (x, y) = (x / length, y / length);
        let end = |along_m: f64| [away_m * x - along_m * y, away_m * y + along_m * x];
        Some([end(-long_m), end(long_m)])
    }
}

/// The demo's wall; the view belongs to the demo and knows its scene.
fn draw_wall(canvas: &mut Context, plane: &Plane, wall: &DemoWall, reach_m: f64) {
    let cut = plane.cut(&Vector3::x(), wall.x_m, reach_m);
    if let Some([from, to]) = cut {
        canvas.draw(&Stroke::new(from[0], from[1], to[0], to[1], Color::Cyan));
    }
}

fn forces_panel(report: &Report) -> Paragraph<'static> {
    let force = |force_N: f64| format!("{force_N:>9.2} N");
    let mut lines = vec![
        field("mode", format::mode(proto::Mode::from(report.mode))),
        field("law", report.law.map_or("-".into(), |law| law.name().to_owned())),
        field("region", region_word(report)),
        field(
            "off by",
            report
                .approximation_angle_rad
                .map_or("-".into(), |a| format!("{:>7.1} deg", a.to_degrees())),
        ),
        field("hand", report.hand.map_or("unknown".into(), |hand| force(hand.force_N.norm()))),
        field("asked", force(report.requested.force_N.norm())),
        field("chosen", force(report.achievable.force_N.norm())),
        field("felt", known(report).map_or("unknown".into(), force)),
        field("depth", format!("{:>9.3} mm", deepest_mm(report))),
        field("limits", limits(report)),
    ];
    if report.stuck {
        lines.push(Line::from(" STUCK".red().bold()));
    }
    Paragraph::new(lines).block(Block::bordered().title(" forces "))
}

/// How strong what was felt is, where that is known.
fn known(report: &Report) -> Option<f64> {
    let known = report.rendered_source != RenderedSource::Unknown;
    known.then(|| report.rendered.force_N.norm())
}

fn deepest_mm(report: &Report) -> f64 {
    report.contacts().iter().map(|contact| contact.depth_m * 1e3).fold(0.0, f64::max)
}

fn limits(report: &Report) -> String {
    let active = Limit::ALL.into_iter().filter(|limit| report.limits.contains(*limit));
    let names: Vec<_> = active.map(Limit::name).collect();
    if names.is_empty() { "none".into() } else { names.join(" ") }
}

fn brakes_panel<'a>(
    report: &Report,
    names: impl Iterator<Item = &'a str>,
    most_Nm: &[f64],
) -> Paragraph<'static> {
    let bar = |(i, name): (usize, &str)| {
        let commanded_Nm = report.commanded_Nm[i].abs();
        let filled = (18.0 * commanded_Nm / most_Nm[i].max(1e-9)).round().clamp(0.0, 18.0) as usize;
        Line::from(vec![
            Span::raw(format!(" {name:<10}")),
            Span::styled("█".repeat(filled), Style::new().yellow()),
            Span::raw("·".repeat(18 - filled)),
            Span::raw(format!(" {commanded_Nm:>5.1} N m")),
        ])
    };
    let lines: Vec<_> = names.enumerate().map(bar).collect();
    Paragraph::new(lines).block(Block::bordered().title(" actuators "))
}

fn latency_panel(daemon: &Daemon, figures: &RunFigures) -> Paragraph<'static> {
    let us = |us: f64| format!("{us:>7.0} us");
    let lines = vec![
        field("wake-up p50", us(figures.wakeup_p50_us)),
        field("wake-up p99", us(figures.wakeup_p99_us)),
        field("tick p99", format!("{:>7.1} us", figures.tick_p99_us)),
        field("overruns", format!("{:>7} of {}", figures.overruns, figures.ticks)),
        field("round trip", figures.rtt_p50_us.map_or("-".into(), us)),
        field("next tick", percent(figures.command_lag_one_ratio)),
        field("stuck", percent(Some(figures.stuck_ratio))),
        field("deepest", format!("{:>7.3} mm", figures.penetration_max_mm)),
        field("metrics", format!("http://{}/metrics", daemon.http_address)),
    ];
    Paragraph::new(lines).block(Block::bordered().title(" latency "))
}

fn field(name: &str, value: impl Into<String>) -> Line<'static> {
    Line::from(vec![Span::raw(format!(" {name:<12}")).dark_gray(), Span::raw(value.into())])
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::telemetry::{RoundTrips, RunSummary};

    #[test]
    fn a_wall_of_the_world_is_drawn_where_the_mounted_device_meets_it() {
        // The device stands at x = 0.1 m and is turned by a quarter: its x is the world's y.
        let mount = Mount {
            p_WB_m: Vector3::new(0.1, 0.0, 0.0),
            q_WB: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_2),
        };
        let plane = Plane(&mount);
        let [from, to] = plane.cut(&Vector3::x(), 0.3, 1.0).unwrap();
        for end in [from, to] {
            assert!((end[1] + 0.2).abs() < 1e-12 && (end[0].abs() - 1.0).abs() < 1e-12, "{end:?}");
        }
        let [x, y] = plane.point(&Vector3::new(0.3, 0.05, 0.0));
        assert!((x - 0.05).abs() < 1e-12 && (y + 0.2).abs() < 1e-12, "{x} {y}");
        assert_eq!(plane.cut(&Vector3::z(), 0.0, 1.0), None);
    }

    #[test]
    fn what_is_not_known_is_said_to_be() {
        assert_eq!(known(&Report::default()), None);
        let figures = RunSummary::new(1_000_000).figures(&RoundTrips::default());
        let text = line(&Report::default(), &figures);
        assert!(text.contains("hand unknown") && !text.contains("NaN"), "{text}");
    }
}
