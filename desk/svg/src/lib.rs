//! SVG page for the book's charts: a frame, a title for screen readers, and text in one font.

use std::fmt::Display;

/// Default text colour.
pub const TEXT_COLOUR: &str = "#1f2328";

/// Formats a chart as an SVG file; `content` is drawn on a page of this width and height, pixels.
pub fn page(title: &str, [width, height]: [f64; 2], font_pixels: u8, content: impl Display) -> String {
    let title = escaped(title);
    let [frame_width, frame_height] = [width, height].map(|side| side - 1.0);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{title}\">\n<title>{title}</title>\n\
         <rect x=\"0.5\" y=\"0.5\" width=\"{frame_width}\" height=\"{frame_height}\" rx=\"8\" fill=\"#ffffff\" \
         stroke=\"#d0d7de\"/>\n\
         <g font-family=\"system-ui, 'DejaVu Sans', sans-serif\" font-size=\"{font_pixels}\" fill=\"{TEXT_COLOUR}\">\n\
         {content}</g>\n</svg>\n"
    )
}

/// Escapes a text for an element or an attribute.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_title_may_have_any_characters() {
        let page = page("\"a\" < b & c", [100.0, 50.0], 13, "<path d=\"M0 0\"/>\n");
        assert_eq!(page.matches("&quot;a&quot; &lt; b &amp; c").count(), 2);
        assert!(!page.contains("\"a\""));
        assert!(page.ends_with("<path d=\"M0 0\"/>\n</g>\n</svg>\n"), "{page}");
        assert!(page.contains("viewBox=\"0 0 100 50\"") && page.contains("width=\"99\" height=\"49\""));
    }
}
