//! The sheet of pixels that a picture is written from: panels, titles and the legend.

use std::convert::Infallible;
use std::path::Path;

use embedded_graphics::Drawable;
use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::ascii::FONT_10X20;
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::{DrawTarget, OriginDimensions, Pixel, Point, RgbColor, Size};
use embedded_graphics::text::{Alignment, Text};

use super::colour::{FLIPPED, Paint};
use super::raster::Canvas;
use crate::mesh::io::{WriteError, write_atomically};

/// Width of the legend at the right, in pixels.
const LEGEND: usize = 130;
/// Width of its bar.
const BAR: usize = 24;

/// Rows of pixels, the upper one first.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sheet {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 3]>,
}

impl OriginDimensions for Sheet {
    fn size(&self) -> Size {
        Size::new(self.width as u32, self.height as u32)
    }
}

impl DrawTarget for Sheet {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        for Pixel(at, colour) in pixels {
            if let (Ok(x), Ok(y)) = (usize::try_from(at.x), usize::try_from(at.y)) {
                self.set(x, y, [colour.r(), colour.g(), colour.b()]);
            }
        }
        Ok(())
    }
}

impl Sheet {
    /// A white sheet with room for panels, and for the legend beside them.
    pub(super) fn new(panels_width: usize, height: usize) -> Self {
        let width = panels_width + LEGEND;
        Self { width, height, pixels: vec![[255; 3]; width * height] }
    }

    fn set(&mut self, x: usize, y: usize, colour: [u8; 3]) {
        if x < self.width && y < self.height {
            self.pixels[y * self.width + x] = colour;
        }
    }

    /// The colour of a pixel.
    #[cfg(test)]
    pub(super) fn pixel(&self, x: usize, y: usize) -> [u8; 3] {
        self.pixels[y * self.width + x]
    }

    /// Puts a square panel as high as the sheet at a column, each pixel the mean of `samples` squared.
    pub(super) fn place(&mut self, column: usize, canvas: &Canvas, samples: usize) {
        for y in 0..self.height {
            for x in 0..self.height {
                self.set(column + x, y, bytes(canvas.mean(x, y, samples)));
            }
        }
    }

    /// A title about the given column.
    pub(super) fn title(&mut self, middle: usize, text: &str) {
        self.write(text, middle, 24, Alignment::Center);
    }

    /// The meaning of the colours, at the right.
    pub(super) fn legend(&mut self, paint: &Paint) {
        let (left, top, bottom) = (self.width - LEGEND, 70, self.height - 60);
        self.write(paint.heading(), left, top - 16, Alignment::Left);
        if let Some(scale) = &paint.scale {
            for y in top..bottom {
                let part = (bottom - 1 - y) as f64 / (bottom - 1 - top) as f64;
                (0..BAR).for_each(|x| self.set(left + x, y, bytes(scale.colour(part))));
            }
            const LABELS: usize = 6;
            for label in 0..LABELS {
                let part = label as f64 / (LABELS - 1) as f64;
                let y = bottom - 1 - ((bottom - 1 - top) as f64 * part).round() as usize;
                (BAR..BAR + 5).for_each(|x| self.set(left + x, y, [0; 3]));
                self.write(&three_digits(scale.value(part)), left + BAR + 9, y + 6, Alignment::Left);
            }
        } else {
            for (line, text) in ["red r", "green phi", "blue theta"].into_iter().enumerate() {
                self.write(text, left, top + 14 + 24 * line, Alignment::Left);
            }
        }
        if paint.shows_flipped() {
            for y in bottom + 16..bottom + 16 + BAR {
                (0..BAR).for_each(|x| self.set(left + x, y, bytes(FLIPPED)));
            }
            self.write("flipped", left + BAR + 9, bottom + 33, Alignment::Left);
        }
    }

    fn write(&mut self, text: &str, x: usize, y: usize, alignment: Alignment) {
        let style = MonoTextStyle::new(&FONT_10X20, Rgb888::BLACK);
        let text = Text::with_alignment(text, Point::new(x as i32, y as i32), style, alignment);
        text.draw(self).expect("drawing into memory cannot fail");
    }

    /// Writes a PNG.
    pub(super) fn write_png(&self, path: &Path) -> Result<(), WriteError> {
        write_atomically(path, |file| {
            let mut encoder = png::Encoder::new(file, self.width as u32, self.height as u32);
            encoder.set_color(png::ColorType::Rgb);
            encoder.set_depth(png::BitDepth::Eight);
            encoder.set_compression(png::Compression::High);
            let mut writer = encoder.write_header()?;
            writer.write_image_data(self.pixels.as_flattened())?;
            Ok(writer.finish()?)
        })
    }
}

fn bytes(colour: [f64; 3]) -> [u8; 3] {
    colour.map(|part| (part.clamp(0.0, 1.0) * 255.0).round() as u8)
}

/// A number with three significant digits.
fn three_digits(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-2..1e4).contains(&size) {
        return format!("{value:.1e}");
    }
    let decimals = if size >= 99.95 {
        0
    } else if size >= 9.995 {
        1
    } else {
        2
    };
    format!("{value:.decimals$}")
}
