//! `hapticd ctl hand`: pull the handle of a simulated device, by arrow keys or to one place.
//!
//! The server has to run with `--hand pointer`. The target is sent many times a second, also
//! while it stands still: a hand of which nothing is heard lets go.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use anyhow::ensure;
use clap::Args;
use ratatui::Frame;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use ratatui::layout::{Constraint, Layout};
use ratatui::text::Line;
use ratatui::widgets::{Block, Paragraph};

use super::format::{self, parse_seconds, parse_vector};
use crate::client::{Client, ConnectString, Incoming, Options};
use crate::proto::{Mode, Region, Role, State, Vector3};

/// Between two targets.
const PACE: Duration = Duration::from_millis(20);

/// One press of an arrow key, and one with shift.
const STEP_M: f32 = 0.005;
const FINE_STEP_M: f32 = 0.001;

/// The target runs ahead of the handle by at most this: the hand is as strong then as it gets.
const LONGEST_LEAD_M: f32 = 0.1;

/// Pull the handle of a simulated device (of `serve --hand pointer`).
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd serve --hand pointer        in one terminal, then
  hapticd ctl wall add board --point 0.3,0,0 --normal=-1,0,0 --stiffness 5000
  hapticd ctl hand                    arrow keys pull, space lets go, q ends
  hapticd ctl hand --to 0.32,0.1,0 --seconds 3")]
pub struct Hand {
    /// Pull there, without a picture
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    to: Option<Vector3>,
    /// For how long
    #[arg(long, value_name = "N", value_parser = parse_seconds, allow_negative_numbers = true)]
    seconds: Option<Duration>,
}

impl Hand {
    /// Pulls until told otherwise.
    pub async fn run(self, target: &ConnectString, device: &str) -> anyhow::Result<()> {
        let screen = self.to.is_none();
        ensure!(
            !screen || std::io::stdout().is_terminal(),
            "arrow keys need a terminal; without one say where to pull: --to X,Y,Z"
        );
        let options = Options {
            device: device.to_owned(),
            state_interval: PACE,
            ..Options::new("hapticd ctl hand", Role::Hand)
        };
        let mut client = Client::connect(target, options).await?;
        let until = self.seconds.map(|seconds| Instant::now() + seconds);
        let mut pull = Pull::default();
        let result = match self.to {
            Some(to) => pull.towards(&mut client, &to, until).await,
            None => pull.by_keys(&mut client, until).await,
        };
        client.send_hand([0.0; 3], false, 0)?;
        client.close().await;
        let state = result?;
        if let (false, Some(state)) = (screen, &state) {
            say!("the tool is at {}, felt {}", place(&state.position_m), felt(state));
        }
        Ok(())
    }
}

/// Where the hand pulls.
#[derive(Debug, Default)]
struct Pull {
    /// `None` until the first State says where the handle is.
    target_m: Option<[f32; 3]>,
    held: bool,
    button: bool,
}

impl Pull {
    async fn towards(
        &mut self,
        client: &mut Client,
        to: &Vector3,
        until: Option<Instant>,
    ) -> anyhow::Result<Option<State>> {
        (self.target_m, self.held) = (Some([to.x as f32, to.y as f32, to.z as f32]), true);
        let mut state = None;
        let mut interrupted = std::pin::pin!(tokio::signal::ctrl_c());
        while until.is_none_or(|until| Instant::now() < until) {
            tokio::select! {
                heard = self.step(client) => state = heard?.or(state),
                _ = &mut interrupted => break,
            }
        }
        Ok(state)
    }

    async fn by_keys(
        &mut self,
        client: &mut Client,
        until: Option<Instant>,
    ) -> anyhow::Result<Option<State>> {
        let mut terminal = ratatui::try_init()?;
        let mut state = None;
        let result = loop {
            match self.step(client).await {
                Ok(heard) => state = heard.or(state),
                Err(error) => break Err(error),
            }
            if let Err(error) = terminal.draw(|frame| self.draw(frame, state.as_ref())) {
                break Err(error.into());
            }
            match self.hear_keys(state.as_ref()) {
                Ok(true) => break Ok(()),
                Ok(false) if until.is_some_and(|until| Instant::now() >= until) => break Ok(()),
                Ok(false) => {}
                Err(error) => break Err(error),
            }
        };
        ratatui::restore();
        result.map(|()| state)
    }

    /// Sends the target and listens for one pace; the newest State heard.
    async fn step(&self, client: &mut Client) -> anyhow::Result<Option<State>> {
        if let Some(target_m) = self.target_m {
            client.send_hand(target_m, self.held, self.button.into())?;
        }
        let (over, mut newest) = (tokio::time::Instant::now() + PACE, None);
        while let Ok(incoming) = tokio::time::timeout_at(over, client.next()).await {
            if let Incoming::State(state) = incoming? {
                newest = Some(*state);
            }
        }
        Ok(newest)
    }

    /// Takes what was typed; true when the user wants to leave.
    fn hear_keys(&mut self, state: Option<&State>) -> anyhow::Result<bool> {
        while event::poll(Duration::ZERO)? {
            let Event::Key(key) = event::read()? else { continue };
            if key.kind == KeyEventKind::Release {
                continue;
            }
            let control = key.modifiers.contains(KeyModifiers::CONTROL);
            let fine = key.modifiers.contains(KeyModifiers::SHIFT);
            match key.code {
                KeyCode::Char('c') if control => return Ok(true),
                KeyCode::Char('q') | KeyCode::Esc => return Ok(true),
                KeyCode::Char(' ') => self.held = false,
                KeyCode::Char('b') => self.button = !self.button,
                code => self.lead(code, fine, state),
            }
        }
        Ok(false)
    }

    /// Moves the target by a key; a hand that had let go takes the handle where it is.
    fn lead(&mut self, code: KeyCode, fine: bool, state: Option<&State>) {
        let Some(&[x, y, z]) = state.and_then(|state| state.position_m.get(..3)) else { return };
        let [dx, dy] = match code {
            KeyCode::Left => [-1.0, 0.0],
            KeyCode::Right => [1.0, 0.0],
            KeyCode::Up => [0.0, 1.0],
            KeyCode::Down => [0.0, -1.0],
            _ => return,
        };
        let step_m = if fine { FINE_STEP_M } else { STEP_M };
        let from_m = self.target_m.filter(|_| self.held).unwrap_or([x, y, z]);
        let limited = |to: f32, at: f32| to.clamp(at - LONGEST_LEAD_M, at + LONGEST_LEAD_M);
        self.target_m =
            Some([limited(from_m[0] + dx * step_m, x), limited(from_m[1] + dy * step_m, y), z]);
        self.held = true;
    }

    fn draw(&self, frame: &mut Frame, state: Option<&State>) {
        let [panel] = Layout::vertical([Constraint::Length(11)]).areas(frame.area());
        let mut lines = vec![Line::from(match (self.held, self.target_m) {
            (true, Some(target_m)) => format!("pulling to  {}", place(&target_m)),
            _ => "let go".into(),
        })];
        match state {
            None => lines.push(Line::from("waiting for the device")),
            Some(state) => {
                let region = Region::try_from(state.region).unwrap_or_default();
                let mode = Mode::try_from(state.mode).unwrap_or_default();
                lines.extend([
                    Line::from(format!("tool at     {}", place(&state.position_m))),
                    Line::from(format!("felt        {}", felt(state))),
                    Line::from(format!("region      {}", format::region(region))),
                    Line::from(format!("mode        {}", format::mode(mode))),
                    Line::from(if state.stuck { "stuck" } else { "" }),
                ]);
            }
        }
        lines.push(Line::from(""));
        lines.push(Line::from("arrows pull (shift: finely)  space lets go  b button  q quits"));
        frame.render_widget(Paragraph::new(lines).block(Block::bordered().title(" hand ")), panel);
    }
}

fn place(at_m: &[f32]) -> String {
    match at_m {
        [x, y, z, ..] => format!("({x:.4}, {y:.4}, {z:.4}) m"),
        _ => "unknown".into(),
    }
}

fn felt(state: &State) -> String {
    match state.rendered.get(..3) {
        Some(force) => {
            format!("{:.2} N", force.iter().map(|part| part * part).sum::<f32>().sqrt())
        }
        None => "unknown".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_lead_the_target_and_never_far_ahead_of_the_handle() {
        let state = State { position_m: vec![0.3, 0.1, 0.0], ..State::default() };
        let mut pull = Pull::default();
        pull.lead(KeyCode::Right, false, None);
        assert!(pull.target_m.is_none() && !pull.held, "nobody knows where the handle is");
        pull.lead(KeyCode::Right, false, Some(&state));
        pull.lead(KeyCode::Down, true, Some(&state));
        let [x, y, _] = pull.target_m.unwrap();
        assert!((x - 0.305).abs() < 1e-6 && (y - 0.099).abs() < 1e-6 && pull.held);
        for _ in 0..100 {
            pull.lead(KeyCode::Right, false, Some(&state));
        }
        assert!((pull.target_m.unwrap()[0] - 0.4).abs() < 1e-6);
        pull.held = false;
        pull.lead(KeyCode::Left, false, Some(&state));
        assert!((pull.target_m.unwrap()[0] - 0.295).abs() < 1e-6, "taken up where it is");
    }
}
