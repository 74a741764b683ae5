//! The signs that mark points: strokes and filled outlines around a place.

use std::iter::{Once, once};

use plotters::element::{Drawable, PointCollection};
use plotters::style::{Color, RGBColor};
use plotters_backend::{BackendCoord, DrawingBackend, DrawingErrorKind};

use super::Sign;

/// A sign at a place, in whatever coordinates.
pub(super) struct SignAt<C> {
    pub(super) at: C,
    pub(super) sign: Sign,
    pub(super) colour: RGBColor,
    /// Half of its width, pixels.
    pub(super) half_px: f64,
}

impl<'a, C> PointCollection<'a, C> for &'a SignAt<C> {
    type Point = &'a C;
    type IntoIter = Once<&'a C>;

    fn point_iter(self) -> Self::IntoIter {
        once(&self.at)
    }
}

impl<C, DB: DrawingBackend> Drawable<DB> for SignAt<C> {
    fn draw<I: Iterator<Item = BackendCoord>>(
        &self,
        places: I,
        backend: &mut DB,
        _: (u32, u32),
    ) -> Result<(), DrawingErrorKind<DB::ErrorType>> {
        let pen = self.colour.stroke_width((self.half_px / 3.0).round().max(1.0) as u32);
        for (x, y) in places {
            let px = |(across, up): (f64, f64)| {
                let to = |share: f64| (share * self.half_px).round() as i32;
                (x + to(across), y - to(up))
            };
            match self.sign {
                Sign::Dot => {
                    let radius = (0.6 * self.half_px).round().max(1.0) as u32;
                    backend.draw_circle((x, y), radius, &self.colour, true)?;
                }
                Sign::Circle => backend.draw_circle((x, y), self.half_px as u32, &pen, false)?,
                Sign::Square => backend.fill_polygon(SQUARE.map(px), &self.colour)?,
                Sign::Diamond => backend.fill_polygon(DIAMOND.map(px), &self.colour)?,
                Sign::Plus => strokes(backend, &PLUS, px, &pen)?,
                Sign::Cross => strokes(backend, &CROSS, px, &pen)?,
                Sign::Asterisk => strokes(backend, &ASTERISK, px, &pen)?,
            }
        }
        Ok(())
    }
}

type Corner = (f64, f64);

const SQUARE: [Corner; 4] = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
const DIAMOND: [Corner; 4] = [(-1.4, 0.0), (0.0, -1.4), (1.4, 0.0), (0.0, 1.4)];
const PLUS: [[Corner; 2]; 2] = [[(-1.0, 0.0), (1.0, 0.0)], [(0.0, -1.0), (0.0, 1.0)]];
const CROSS: [[Corner; 2]; 2] = [[(-1.0, -1.0), (1.0, 1.0)], [(-1.0, 1.0), (1.0, -1.0)]];
const ASTERISK: [[Corner; 2]; 3] =
    [[(-1.0, 0.0), (1.0, 0.0)], [(-0.5, -0.9), (0.5, 0.9)], [(-0.5, 0.9), (0.5, -0.9)]];

fn strokes<DB: DrawingBackend>(
    backend: &mut DB,
    strokes: &[[Corner; 2]],
    px: impl Fn(Corner) -> BackendCoord,
    pen: &plotters::style::ShapeStyle,
) -> Result<(), DrawingErrorKind<DB::ErrorType>> {
    strokes.iter().try_for_each(|stroke| backend.draw_path(stroke.map(&px), pen))
}
