//! QR codes, for a terminal and as SVG.
//!
//! A margin of four modules belongs to the code (ISO/IEC 18004), and it is dark on light: where a
//! terminal takes colours they are set, whatever its own are.

use std::fmt::Write;

use anyhow::Context;
use qrcode::{Color, EcLevel, QrCode};

const MARGIN: usize = 4;

/// Light on dark, whatever the terminal's own colours are; and back.
const COLOURS: (&str, &str) = ("\x1b[38;5;231;48;5;16m", "\x1b[0m");

/// A code with its margin.
#[derive(Debug)]
pub struct Code {
    /// Modules along an edge.
    size: usize,
    dark: Vec<bool>,
}

impl Code {
    /// For a screen: as small as it gets.
    pub fn for_screen(text: &str) -> anyhow::Result<Self> {
        Self::new(text, EcLevel::L)
    }

    /// For paper: it may lose 15 % of its area.
    pub fn for_paper(text: &str) -> anyhow::Result<Self> {
        Self::new(text, EcLevel::M)
    }

    fn new(text: &str, level: EcLevel) -> anyhow::Result<Self> {
        let code = QrCode::with_error_correction_level(text, level);
        let code = code.context("the connect string does not fit a QR code")?;
        let (width, colours) = (code.width(), code.to_colors());
        let size = width + 2 * MARGIN;
        let mut dark = vec![false; size * size];
        for (row, colours) in colours.chunks(width).enumerate() {
            for (column, colour) in colours.iter().enumerate() {
                dark[(row + MARGIN) * size + column + MARGIN] = *colour == Color::Dark;
            }
        }
        Ok(Self { size, dark })
    }

    /// Lines of half blocks, two modules high: light modules are drawn.
    pub fn text(&self, coloured: bool) -> String {
        let (on, off) = if coloured { COLOURS } else { ("", "") };
        let mut text = String::new();
        for pair in self.dark.chunks(2 * self.size) {
            let (upper, lower) = pair.split_at(self.size);
            text.push_str(on);
            for (column, upper_dark) in upper.iter().enumerate() {
                // Below the last row there is nothing to draw.
                let lower_light = lower.get(column).is_some_and(|dark| !dark);
                text.push(match (!upper_dark, lower_light) {
                    (true, true) => '\u{2588}',
                    (true, false) => '\u{2580}',
                    (false, true) => '\u{2584}',
                    (false, false) => ' ',
                });
            }
            text.push_str(off);
            text.push('\n');
        }
        text
    }

    /// A picture of one path; runs of dark modules are one rectangle each.
    pub fn svg(&self) -> String {
        let size = self.size;
        let mut path = String::new();
        for (y, row) in self.dark.chunks(size).enumerate() {
            let mut x = 0;
            for run in row.chunk_by(|a, b| a == b) {
                if run[0] {
                    // A String takes whatever is written.
                    let _ = write!(path, "M{x} {y}h{0}v1h-{0}z", run.len());
                }
                x += run.len();
            }
        }
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"60mm\" height=\"60mm\" \
             viewBox=\"0 0 {size} {size}\" shape-rendering=\"crispEdges\">\n\
             <rect width=\"{size}\" height=\"{size}\" fill=\"#fff\"/>\n\
             <path d=\"{path}\"/>\n</svg>\n"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What another program reads in the code.
    fn read(code: &Code) -> String {
        let scale = 3;
        let pixel = |x: usize, y: usize| {
            if code.dark[y / scale * code.size + x / scale] { 0 } else { 255 }
        };
        let edge = code.size * scale;
        let mut picture = rqrr::PreparedImage::prepare_from_greyscale(edge, edge, pixel);
        let grids = picture.detect_grids();
        assert_eq!(grids.len(), 1);
        grids[0].decode().unwrap().1
    }

    #[test]
    fn another_program_reads_what_was_written() {
        let hash = "0123456789abcdef".repeat(4);
        for text in [
            format!("hapticd://192.168.1.20:7351/?sha256={hash}&token={}", "aZ-_0".repeat(8)),
            format!("hapticd://[2001:db8::1]:7351/?sha256={hash}&token=x&grpc=7450"),
            format!("hapticd://{}:1/", "a-long-name.".repeat(20)),
        ] {
            for code in [Code::for_screen(&text).unwrap(), Code::for_paper(&text).unwrap()] {
                assert_eq!(read(&code), text);
            }
        }
        assert!(Code::for_paper(&"x".repeat(3000)).is_err());
    }

    #[test]
    fn both_drawings_have_every_module() {
        let code = Code::for_screen("hapticd").unwrap();
        let mut drawn = Vec::new();
        for line in code.text(false).lines() {
            let halves = |light: [char; 2]| line.chars().map(move |c| !light.contains(&c));
            drawn.extend(halves(['\u{2588}', '\u{2580}']));
            drawn.extend(halves(['\u{2588}', '\u{2584}']));
        }
        drawn.truncate(code.dark.len());
        assert_eq!(drawn, code.dark);
        for line in code.text(true).lines() {
            assert!(line.starts_with("\x1b[38") && line.ends_with("\x1b[0m"));
        }

        let svg = code.svg();
        let path = svg.split_once("d=\"").unwrap().1.split_once('"').unwrap().0;
        let mut drawn = vec![false; code.dark.len()];
        for run in path.split('z').filter(|run| !run.is_empty()) {
            let numbers: Vec<usize> =
                run.split(|c: char| !c.is_ascii_digit()).filter_map(|n| n.parse().ok()).collect();
            let [x, y, length, 1, back] = numbers[..] else { panic!("{run}") };
            assert_eq!(back, length);
            drawn[y * code.size + x..][..length].fill(true);
        }
        assert_eq!(drawn, code.dark);
    }
}
