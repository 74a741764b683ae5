//! `hapticd top`: all devices of a server, one row each, again and again.
//!
//! Rates and percentiles are those of the time between two looks, from `/metrics`; forces and
//! modes are those of the last tick, from the services. What is not known is `-`.

mod metrics;

use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use clap::Args;
use ratatui::Frame;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyModifiers};
use ratatui::layout::{Constraint, Layout};
use ratatui::style::Style;
use ratatui::text::Line;
use ratatui::widgets::{Block, Paragraph, Row, Table};
use serde_json::{Value, json};

use super::ctl::plain;
use super::format;
use super::target::Target;
use crate::client::Services;
use crate::proto::{DeviceState, GetStateRequest, ListDevicesRequest, Mode, Region, Wrench};
use metrics::{Scrape, label};

/// Between two looks.
const PERIOD: Duration = Duration::from_secs(1);

/// Between two looks at the keyboard.
const KEYS: Duration = Duration::from_millis(50);

/// Watch all devices of a server: timing, forces, sessions
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd top
  hapticd top --once
  hapticd top --once --json")]
pub struct Top {
    #[command(flatten)]
    target: Target,
    /// Where /metrics is; without it, where the server says
    #[arg(long, value_name = "HOST:PORT")]
    http: Option<String>,
    /// Look for a second, print and end
    #[arg(long)]
    once: bool,
    /// Print one JSON object a look
    #[arg(long)]
    json: bool,
}

/// One look at a server.
#[derive(Debug, Default)]
struct Look {
    rows: Vec<DeviceRow>,
    /// Role and number.
    sessions: Vec<(String, f64)>,
}

/// One device.
#[derive(Debug, Default)]
struct DeviceRow {
    state: DeviceState,
    ticks_per_s: Option<f64>,
    overruns: Option<f64>,
    tick_p99_us: Option<f64>,
    late_p99_us: Option<f64>,
    stuck: Option<f64>,
}

impl Top {
    /// Looks until told otherwise.
    pub fn run(self) -> anyhow::Result<()> {
        super::runtime()?.block_on(self.watch())
    }

    async fn watch(self) -> anyhow::Result<()> {
        let screen = !self.once && !self.json;
        ensure!(
            !screen || std::io::stdout().is_terminal(),
            "a live view needs a terminal; without one say --once or --json"
        );
        let mut services = self.target.services().await?;
        let http = self.http_authority(&mut services).await?;
        let mut last = (Scrape::get(&http).await?, Instant::now());
        if screen {
            return live(&mut services, &http, last).await;
        }
        loop {
            tokio::select! {
                () = tokio::time::sleep(PERIOD) => {}
                signal = tokio::signal::ctrl_c() => return Ok(signal?),
            }
            let look = look(&mut services, &http, &mut last).await?;
            if self.json {
                say!("{}", look.json());
            } else {
                look.text().iter().for_each(|line| say!("{line}"));
            }
            if self.once {
                return Ok(());
            }
        }
    }

    async fn http_authority(&self, services: &mut Services) -> anyhow::Result<String> {
        if let Some(http) = &self.http {
            return Ok(http.clone());
        }
        let listed = services.devices.list_devices(ListDevicesRequest {}).await.map_err(plain)?;
        let port = listed.get_ref().http_port;
        ensure!(port != 0, "the server does not say where /metrics is: use --http HOST:PORT");
        let authority = self.target.connect.grpc_authority();
        let (host, _) = authority.rsplit_once(':').context("no host")?;
        Ok(format!("{host}:{port}"))
    }
}

/// The terminal is given back however this ends, by a panic too (`try_init` sees to it).
async fn live(
    services: &mut Services,
    http: &str,
    mut last: (Scrape, Instant),
) -> anyhow::Result<()> {
    let mut terminal = ratatui::try_init()?;
    let result: anyhow::Result<()> = async {
        // Records come in batches: a first look at once would tell rates of next to nothing.
        let (mut newest, mut next) = (Look::default(), Instant::now() + PERIOD / 4);
        loop {
            if Instant::now() >= next {
                newest = look(services, http, &mut last).await?;
                next = Instant::now() + PERIOD;
            }
            terminal.draw(|frame| newest.draw(frame))?;
            if quit_pressed()? {
                return Ok(());
            }
        }
    }
    .await;
    ratatui::restore();
    result
}

fn quit_pressed() -> anyhow::Result<bool> {
    if !event::poll(KEYS)? {
        return Ok(false);
    }
    Ok(match event::read()? {
        Event::Key(key) => {
            let control = key.modifiers.contains(KeyModifiers::CONTROL);
            (control && key.code == KeyCode::Char('c'))
                || matches!(key.code, KeyCode::Char('q') | KeyCode::Esc)
        }
        _ => false,
    })
}

async fn look(
    services: &mut Services,
    http: &str,
    last: &mut (Scrape, Instant),
) -> anyhow::Result<Look> {
    let listed = services.devices.list_devices(ListDevicesRequest {}).await.map_err(plain)?;
    let (now, at) = (Scrape::get(http).await?, Instant::now());
    let (before, since) = std::mem::replace(last, (now.clone(), at));
    let seconds = at.duration_since(since).as_secs_f64();
    let mut rows = Vec::new();
    for device in listed.into_inner().devices {
        let name = device.name;
        let request = GetStateRequest { name: name.clone() };
        let state = services.devices.get_state(request).await.map_err(plain)?.into_inner();
        rows.push(row(state, name.trim_start_matches("devices/"), &before, &now, seconds));
    }
    // Of every transport together.
    let mut sessions = BTreeMap::new();
    for (labels, count) in now.samples("hapticd_sessions", &[]).filter(|(_, count)| *count > 0.0) {
        let role = label(labels, "role").unwrap_or("session").to_owned();
        *sessions.entry(role).or_insert(0.0) += count;
    }
    Ok(Look { rows, sessions: sessions.into_iter().collect() })
}

fn row(state: DeviceState, name: &str, before: &Scrape, now: &Scrape, seconds: f64) -> DeviceRow {
    let labels = [("device", name)];
    let grown = |metric: &str| Some(now.value(metric, &labels)? - before.value(metric, &labels)?);
    let p99_us = |metric: &str| {
        let quantile_s = now.quantile_since(before, metric, &labels, 0.99);
        quantile_s.map(|quantile_s| quantile_s * 1e6)
    };
    let ticks = grown("hapticd_loop_ticks_total");
    let stuck = grown("hapticd_stuck_ticks_total");
    DeviceRow {
        state,
        ticks_per_s: ticks.filter(|_| seconds > 0.0).map(|ticks| ticks / seconds),
        overruns: now.value("hapticd_loop_overruns_total", &labels),
        tick_p99_us: p99_us("hapticd_loop_execution_seconds"),
        late_p99_us: p99_us("hapticd_loop_wakeup_lateness_seconds"),
        stuck: ticks.zip(stuck).filter(|(ticks, _)| *ticks > 0.0).map(|(ticks, n)| n / ticks),
    }
}

const HEADS: [&str; 12] = [
    "device", "mode", "law", "ticks/s", "overruns", "tick p99", "late p99", "asked", "chosen",
    "felt", "region", "stuck",
];
const WIDTHS: [u16; 12] = [22, 9, 19, 8, 9, 9, 9, 9, 9, 9, 16, 7];

impl DeviceRow {
    fn cells(&self) -> [String; 12] {
        let number = |value: Option<f64>, digits: usize, unit: &str| match value {
            Some(value) if value.is_finite() => format!("{value:.digits$}{unit}"),
            Some(_) => "beyond".into(),
            None => "-".into(),
        };
        let state = &self.state;
        let region = match state.region() {
            Region::Unspecified => "-".into(),
            region => format::region(region),
        };
        [
            state.name.trim_start_matches("devices/").to_owned(),
            format::mode(state.mode()),
            format::law(state.law()),
            number(self.ticks_per_s, 0, ""),
            number(self.overruns, 0, ""),
            number(self.tick_p99_us, 1, " us"),
            number(self.late_p99_us, 0, " us"),
            number(force_N(state.requested.as_ref()), 1, " N"),
            number(force_N(state.achievable.as_ref()), 1, " N"),
            number(force_N(state.rendered.as_ref()), 1, " N"),
            region,
            number(self.stuck.map(|share| share * 100.0), 1, " %"),
        ]
    }

    fn json(&self) -> Value {
        let state = &self.state;
        json!({
            "name": state.name,
            "mode": format::mode(state.mode()),
            "law": format::law(state.law()),
            "ticks_per_s": self.ticks_per_s,
            "overruns": self.overruns,
            "tick_p99_us": self.tick_p99_us,
            "lateness_p99_us": self.late_p99_us,
            "asked_n": force_N(state.requested.as_ref()),
            "chosen_n": force_N(state.achievable.as_ref()),
            "felt_n": force_N(state.rendered.as_ref()),
            "region": format::word(state.region().as_str_name(), "REGION_"),
            "stuck_ratio": self.stuck,
        })
    }
}

fn force_N(wrench: Option<&Wrench>) -> Option<f64> {
    wrench.and_then(|wrench| wrench.force_n.as_ref()).map(format::norm)
}

impl Look {
    fn sessions(&self) -> String {
        let each: Vec<_> =
            self.sessions.iter().map(|(role, count)| format!("{count} {role}")).collect();
        if each.is_empty() {
            "no sessions".into()
        } else {
            format!("sessions: {}", each.join(", "))
        }
    }

    fn text(&self) -> Vec<String> {
        let line = |cells: Vec<String>| {
            let padded = cells.iter().zip(WIDTHS).map(|(cell, width)| {
                let width = usize::from(width);
                format!("{cell:<width$}")
            });
            padded.collect::<Vec<_>>().join(" ").trim_end().to_owned()
        };
        let mut lines = vec![line(HEADS.map(str::to_owned).to_vec())];
        lines.extend(self.rows.iter().map(|row| line(row.cells().to_vec())));
        lines.push(self.sessions());
        lines
    }

    fn json(&self) -> Value {
        let sessions: serde_json::Map<_, _> =
            self.sessions.iter().map(|(role, count)| (role.clone(), json!(count))).collect();
        let devices: Vec<_> = self.rows.iter().map(DeviceRow::json).collect();
        json!({ "devices": devices, "sessions": sessions })
    }

    fn draw(&self, frame: &mut Frame) {
        let [table, foot] =
            Layout::vertical([Constraint::Min(3), Constraint::Length(1)]).areas(frame.area());
        let rows = self.rows.iter().map(|row| {
            let style = match row.state.mode() {
                Mode::Fault => Style::new().red(),
                Mode::Enabled => Style::new(),
                _ => Style::new().yellow(),
            };
            Row::new(row.cells()).style(style)
        });
        let widths = WIDTHS.map(Constraint::Length);
        let head = Row::new(HEADS).style(Style::new().bold());
        let block = Block::bordered().title(" hapticd top ");
        frame.render_widget(Table::new(rows, widths).header(head).block(block), table);
        let line = Line::from(format!(" {}   q quits", self.sessions()));
        frame.render_widget(Paragraph::new(line), foot);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_known_is_a_dash_and_every_column_has_its_head() {
        let look = Look { rows: vec![DeviceRow::default()], sessions: Vec::new() };
        let text = look.text();
        assert_eq!(text.len(), 3);
        assert!(text[1].contains(" - ") && !text[1].contains("NaN"), "{text:?}");
        assert_eq!(text[2], "no sessions");
        assert!(look.json()["devices"][0]["ticks_per_s"].is_null());
        for (head, width) in HEADS.iter().zip(WIDTHS) {
            assert!(head.len() < usize::from(width) + 1, "{head}");
        }
    }
}
