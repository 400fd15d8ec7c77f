//! Images in the page, as PNG in data URIs, and the figure that compares two of them.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use crate::export::heatmap::{HeatmapScale, heatmap};
use raywave::image::{Image, WriteOptions, image_bytes};

/// Every image once, however often the page is written and whoever shares it.
#[derive(Debug, Default)]
pub struct EncodedImages {
    exposure_stops: f32,
    /// Holding the image keeps its address from being given to another.
    known: HashMap<(usize, Option<usize>), Encoded>,
}

#[derive(Debug)]
struct Encoded {
    uri: String,
    /// The range of a heat map.
    range: (f64, f64),
    _held: Vec<Arc<Image>>,
}

impl EncodedImages {
    pub fn new(exposure_stops: f32) -> Self {
        Self { exposure_stops, known: HashMap::new() }
    }

    /// The data URI of an image.
    pub fn image(&mut self, image: &Arc<Image>) -> &str {
        let exposure = self.exposure_stops;
        let encoded = self.known.entry((address(image), None)).or_insert_with(|| Encoded {
            uri: data_uri(image, exposure),
            range: (0.0, 0.0),
            _held: vec![Arc::clone(image)],
        });
        &encoded.uri
    }

    /// The data URI of the difference of two images of one size, and the range of its logarithmic
    /// scale.
    pub fn difference(&mut self, a: &Arc<Image>, b: &Arc<Image>) -> (&str, (f64, f64)) {
        let encoded = self.known.entry((address(a), Some(address(b)))).or_insert_with(|| {
            let (image, low, high) = heatmap(a, b, HeatmapScale::Relative);
            Encoded { uri: data_uri(&image, 0.0), range: (low, high), _held: vec![Arc::clone(a), Arc::clone(b)] }
        });
        (&encoded.uri, encoded.range)
    }
}

/// The images of a page, each once.
pub struct PageImages<'a> {
    encoded: &'a mut EncodedImages,
    uris: Vec<String>,
}

impl<'a> PageImages<'a> {
    /// A page without images.
    pub fn new(encoded: &'a mut EncodedImages) -> Self {
        Self { encoded, uris: Vec::new() }
    }

    /// The images, by their index.
    pub fn into_uris(self) -> Vec<String> {
        self.uris
    }

    fn add(&mut self, uri: &str) -> usize {
        self.uris.iter().position(|known| known == uri).unwrap_or_else(|| {
            self.uris.push(uri.to_owned());
            self.uris.len() - 1
        })
    }

    /// The index of an image in the page.
    pub fn add_image(&mut self, image: &Arc<Image>) -> usize {
        let uri = self.encoded.image(image).to_owned();
        self.add(&uri)
    }

    /// The index of the heat map of two images, and the range of its logarithmic scale.
    pub fn add_difference(&mut self, a: &Arc<Image>, b: &Arc<Image>) -> (usize, f64, f64) {
        let (uri, (low, high)) = self.encoded.difference(a, b);
        let uri = uri.to_owned();
        (self.add(&uri), low, high)
    }
}

/// A figure of two images with a divider, and their difference, for the page's script: `options` are elements
/// whose data name the images.
pub fn image_figure(caption: &str, options: &str, (width, height): (u32, u32)) -> String {
    if options.is_empty() {
        return String::new();
    }
    let (width, height) = (width.max(1), height.max(1));
    format!(
        "<figure class=\"images\"><figcaption>{caption}</figcaption>\n\
         <div class=\"controls\"><label>Against <span class=\"base\"></span>: <select>\n{options}</select></label>\
         <label class=\"switch\"><input type=\"checkbox\" class=\"heat-switch\"> difference</label></div>\n\
         <div class=\"stage\" style=\"aspect-ratio:{width}/{height}\">\
         <img class=\"right\" alt=\"\"><img class=\"left\" alt=\"\"><img class=\"heat\" alt=\"Difference\" hidden>\
         <span class=\"tag left\"></span><span class=\"tag right\"></span>\
         <input type=\"range\" class=\"split\" min=\"0\" max=\"100\" step=\"0.5\" value=\"50\" \
         aria-label=\"Where the left image ends, in percent of the width\"><span class=\"divider\"></span></div>\n\
         <p class=\"note\" aria-live=\"polite\"></p></figure>\n"
    )
}

fn address(image: &Arc<Image>) -> usize {
    Arc::as_ptr(image).addr()
}

fn data_uri(image: &Image, exposure: f32) -> String {
    let options = WriteOptions { exposure, ..WriteOptions::default() };
    // An image without pixels has no PNG; an empty URI shows as a missing image.
    let bytes = image_bytes(Path::new("image.png"), image, &options).unwrap_or_default();
    format!("data:image/png;base64,{}", base64(&bytes))
}

/// Base 64 of RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let group = chunk.iter().fold(0_u32, |group, &byte| group << 8 | u32::from(byte)) << (8 * (3 - chunk.len()));
        for i in 0..4 {
            let sextet = (group >> (18 - 6 * i)) & 63;
            text.push(if i <= chunk.len() { char::from(ALPHABET[sextet as usize]) } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::base64;

    /// The vectors of RFC 4648, section 10.
    #[test]
    fn base64_is_that_of_the_standard() {
        let vectors = [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ];
        for (text, encoded) in vectors {
            assert_eq!(base64(text.as_bytes()), encoded);
        }
    }
}
