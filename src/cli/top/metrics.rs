//! What `hapticd top` needs of a server's `/metrics`: a plain GET, samples, and quantiles.

use std::time::Duration;

use anyhow::{Context, ensure};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

/// Time for an answer.
const PATIENCE: Duration = Duration::from_secs(3);

/// More than any server has to say.
const LARGEST: u64 = 16 << 20;

/// One scrape.
#[derive(Clone, Debug, Default)]
pub struct Scrape(String);

impl Scrape {
    /// What `/metrics` at this address says now.
    pub async fn get(authority: &str) -> anyhow::Result<Self> {
        let answer = tokio::time::timeout(PATIENCE, fetch(authority)).await;
        let text = answer
            .map_err(|_| anyhow::anyhow!("no answer within {} s", PATIENCE.as_secs()))
            .and_then(|answer| answer)
            .with_context(|| format!("http://{authority}/metrics"))?;
        Ok(Self(text))
    }

    /// A sample by its name and the labels that it has, among others.
    pub fn value(&self, name: &str, labels: &[(&str, &str)]) -> Option<f64> {
        self.samples(name, labels).map(|(_, value)| value).next()
    }

    /// All samples of a name that have these labels: the text of their labels, and the value.
    pub fn samples<'a>(
        &'a self,
        name: &'a str,
        labels: &'a [(&'a str, &'a str)],
    ) -> impl Iterator<Item = (&'a str, f64)> {
        self.0.lines().filter_map(move |line| {
            let rest = line.strip_prefix(name)?;
            let (found, value) = match rest.strip_prefix('{') {
                Some(rest) => rest.rsplit_once("} ")?,
                None => ("", rest.strip_prefix(' ')?),
            };
            let has = |(key, value): &(&str, &str)| label(found, key) == Some(*value);
            let value = value.trim().parse().ok()?;
            labels.iter().all(has).then_some((found, value))
        })
    }

    /// A quantile of what a histogram took in since an earlier scrape, by straight lines within
    /// its buckets; `None` where there was nothing, infinite beyond the last bucket.
    pub fn quantile_since(
        &self,
        before: &Self,
        name: &str,
        labels: &[(&str, &str)],
        quantile: f64,
    ) -> Option<f64> {
        let bucket = format!("{name}_bucket");
        let counts = |scrape: &Self| -> Vec<(f64, f64)> {
            let samples = scrape.samples(&bucket, labels);
            let bound = |found: &str| match label(found, "le")? {
                "+Inf" => Some(f64::INFINITY),
                bound => bound.parse().ok(),
            };
            samples.filter_map(|(found, count)| Some((bound(found)?, count))).collect()
        };
        let earlier = counts(before);
        let at = |bound: f64| earlier.iter().find(|(b, _)| *b == bound).map_or(0.0, |(_, n)| *n);
        let counts: Vec<_> = counts(self).into_iter().map(|(b, n)| (b, n - at(b))).collect();
        let total = counts.last().map_or(0.0, |(_, count)| *count);
        if total <= 0.0 {
            return None;
        }
        let wanted = quantile * total;
        let (mut low, mut below) = (0.0, 0.0);
        for (bound, count) in counts {
            if count >= wanted {
                let share = (wanted - below) / (count - below).max(1e-12);
                return Some(if bound.is_finite() { low + share * (bound - low) } else { bound });
            }
            (low, below) = (bound, count);
        }
        None
    }
}

/// The value of a label in a list like `a="x",b="y"`; values here hold no quotes.
pub fn label<'a>(labels: &'a str, key: &str) -> Option<&'a str> {
    labels.split("\",").find_map(|pair| {
        let (found, value) = pair.split_once("=\"")?;
        (found == key).then(|| value.trim_end_matches('"'))
    })
}

async fn fetch(authority: &str) -> anyhow::Result<String> {
    let mut stream = TcpStream::connect(authority).await?;
    // As of HTTP/1.0 the end of the answer is the end of the connection.
    stream
        .write_all(format!("GET /metrics HTTP/1.0\r\nHost: {authority}\r\n\r\n").as_bytes())
        .await?;
    let mut answer = String::new();
    stream.take(LARGEST).read_to_string(&mut answer).await?;
    let (head, body) = answer.split_once("\r\n\r\n").context("that was no HTTP")?;
    let status = head.split(' ').nth(1).unwrap_or_default();
    ensure!(status == "200", "status {status}");
    Ok(body.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scrape(scale: u32) -> Scrape {
        Scrape(format!(
            "# HELP x y\nticks_total{{device=\"a\"}} {}\nticks_total{{device=\"b\"}} 7\nalone 3\n\
             late_seconds_bucket{{device=\"a\",le=\"0.001\"}} {}\n\
             late_seconds_bucket{{device=\"a\",le=\"0.002\"}} {}\n\
             late_seconds_bucket{{device=\"a\",le=\"+Inf\"}} {}\n",
            10 * scale,
            50 * scale,
            99 * scale,
            100 * scale
        ))
    }

    #[test]
    fn samples_are_found_by_name_and_labels() {
        let scrape = scrape(1);
        assert_eq!(scrape.value("ticks_total", &[("device", "b")]), Some(7.0));
        assert_eq!(scrape.value("alone", &[]), Some(3.0));
        assert_eq!(scrape.value("ticks", &[]), None);
        assert_eq!(scrape.value("ticks_total", &[("device", "c")]), None);
        assert_eq!(label("a=\"x\",b=\"y z\"", "b"), Some("y z"));
    }

    #[test]
    fn a_quantile_is_that_of_what_came_since() {
        let (before, now) = (scrape(1), scrape(3));
        let at = |q| now.quantile_since(&before, "late_seconds", &[("device", "a")], q);
        assert!((at(0.25).unwrap() - 0.0005).abs() < 1e-12);
        assert!((at(0.745).unwrap() - 0.0015).abs() < 1e-12);
        assert_eq!(at(0.999), Some(f64::INFINITY));
        assert_eq!(now.quantile_since(&now, "late_seconds", &[("device", "a")], 0.5), None);
        assert_eq!(now.quantile_since(&before, "late_seconds", &[("device", "z")], 0.5), None);
    }
}
