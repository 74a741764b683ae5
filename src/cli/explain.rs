//! `hapticd explain`: why it feels as it does, in words.

use std::time::Duration;

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::ctl::plain;
use super::format;
use super::target::Target;
use crate::proto::{ExplainRequest, Explanation, Role};

/// Between two looks with `--watch`.
const PACE: Duration = Duration::from_millis(250);

/// Tell why the device feels as it does: the force chain of its last tick
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd explain
  hapticd explain --watch
  hapticd explain --as observer --json")]
pub struct Explain {
    #[command(flatten)]
    target: Target,
    /// On behalf of a session of this role
    #[arg(long = "as", value_name = "ROLE")]
    role: Option<AsRole>,
    /// On behalf of this session, sessions/ID
    #[arg(long, value_name = "NAME", default_value = "", hide_default_value = true)]
    session: String,
    /// Again whenever the answer changes, until Ctrl-C
    #[arg(long)]
    watch: bool,
    /// Print JSON, one object per answer
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum AsRole {
    Observer,
    Controller,
    Hand,
}

impl Explain {
    /// Asks and prints.
    pub fn run(self) -> anyhow::Result<()> {
        super::runtime()?.block_on(self.ask())
    }

    async fn ask(self) -> anyhow::Result<()> {
        let (mut services, name) = self.target.open().await?;
        let role = match self.role {
            None => Role::Unspecified,
            Some(AsRole::Observer) => Role::Observer,
            Some(AsRole::Controller) => Role::Controller,
            Some(AsRole::Hand) => Role::Hand,
        };
        let request = ExplainRequest { name, session: self.session, role: role.into() };
        let mut last = None;
        loop {
            let told = services.devices.explain(request.clone()).await.map_err(plain)?.into_inner();
            let reasons: Vec<_> = told.reasons.iter().map(|reason| reason.reason).collect();
            if last.as_ref() != Some(&reasons) {
                print(&told, self.json);
            }
            if !self.watch {
                return Ok(());
            }
            last = Some(reasons);
            tokio::select! {
                () = tokio::time::sleep(PACE) => {}
                signal = tokio::signal::ctrl_c() => return Ok(signal?),
            }
        }
    }
}

fn print(told: &Explanation, as_json: bool) {
    if as_json {
        say!("{}", to_json(told));
        return;
    }
    say!("{}, tick {}: {}", told.name, told.tick, told.summary);
    for (place, reason) in told.reasons.iter().enumerate().skip(1) {
        say!("  {} {}", if place == 1 { "also:" } else { "     " }, reason.text);
    }
    for link in &told.chain {
        match &link.force_n {
            None => say!("  {:<8} {}", link.name, link.text),
            Some(force) => {
                let (size, vector) = (format::norm(force), format::vector(Some(force), 2));
                say!("  {:<8} {size:.2} N {vector}, {}", link.name, link.text);
            }
        }
    }
}

fn to_json(told: &Explanation) -> Value {
    let reasons = told.reasons.iter().map(|reason| {
        let word = format::word(reason.reason().as_str_name(), "REASON_");
        json!({ "reason": word, "text": reason.text })
    });
    let chain = told.chain.iter().map(|link| {
        let force = link.force_n.as_ref().map(|force| [force.x, force.y, force.z]);
        json!({ "name": link.name, "text": link.text, "force_n": force })
    });
    json!({
        "name": told.name,
        "tick": told.tick,
        "summary": told.summary,
        "reasons": reasons.collect::<Vec<_>>(),
        "chain": chain.collect::<Vec<_>>(),
    })
}
