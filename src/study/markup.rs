//! Texts of study files: Markdown in, HTML out.

use pulldown_cmark::{Event, LinkType, Parser, Tag, TagEnd, html};

/// Renders Markdown. HTML in the text is shown as it is written, pictures as their description, and a link only where
/// it leads to `https:`, `http:` or `mailto:`: a text can neither style a page nor run anything on it.
pub(super) fn to_html(markdown: &str) -> String {
    let mut open_links = Vec::new();
    let events = Parser::new(markdown).filter_map(|event| match event {
        Event::Html(text) | Event::InlineHtml(text) => Some(Event::Text(text)),
        Event::Start(Tag::HtmlBlock) => Some(Event::Start(Tag::Paragraph)),
        Event::End(TagEnd::HtmlBlock) => Some(Event::End(TagEnd::Paragraph)),
        Event::Start(Tag::Image { .. }) | Event::End(TagEnd::Image) => None,
        Event::Start(Tag::Link {
            link_type,
            dest_url,
            title,
            id,
        }) => {
            // The address of <name@host> comes without its scheme.
            let is_kept = link_type == LinkType::Email || is_safe_address(&dest_url);
            open_links.push(is_kept);
            is_kept.then_some(Event::Start(Tag::Link {
                link_type,
                dest_url,
                title,
                id,
            }))
        }
        // Links do not nest, yet an end without a start would be taken for one that is kept.
        Event::End(TagEnd::Link) => open_links
            .pop()
            .unwrap_or(false)
            .then_some(Event::End(TagEnd::Link)),
        other => Some(other),
    });
    let mut output = String::new();
    html::push_html(&mut output, events);
    output
}

fn is_safe_address(address: &str) -> bool {
    let address = address.to_ascii_lowercase();
    ["https://", "http://", "mailto:"]
        .iter()
        .any(|scheme| address.starts_with(scheme))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(markdown: &str, expected: &str) {
        assert_eq!(to_html(markdown).trim_end(), expected, "{markdown}");
    }

    #[test]
    fn markdown_is_rendered() {
        check(
            "Two **words**.\n\nMore.",
            "<p>Two <strong>words</strong>.</p>\n<p>More.</p>",
        );
        check("* a\n* b", "<ul>\n<li>a</li>\n<li>b</li>\n</ul>");
    }

    #[test]
    fn html_is_shown_and_never_obeyed() {
        check("a <b>c</b> & d", "<p>a &lt;b&gt;c&lt;/b&gt; &amp; d</p>");
        check(
            "<script>x()</script>",
            "<p>&lt;script&gt;x()&lt;/script&gt;</p>",
        );
        check("![eyes](https://a.example/x.png)", "<p>eyes</p>");
    }

    #[test]
    fn only_plain_links_are_links() {
        check(
            "[a](https://b.example)",
            "<p><a href=\"https://b.example\">a</a></p>",
        );
        check(
            "<lab@uni.example>",
            "<p><a href=\"mailto:lab@uni.example\">lab@uni.example</a></p>",
        );
        check(
            "[a](javascript:x) [b](JavaScript:y) [c](/r)",
            "<p>a b c</p>",
        );
    }
}
