//! The description of streams in the header, as XML.

use gs2e_image::Size;
use roxmltree::{Document, Node};

/// A stream of events.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct StreamInfo {
    pub(super) id: i32,
    pub(super) size: Size,
}

/// The description of one stream of events, numbered 0.
pub(super) fn write_info(size: Size) -> String {
    let attribute =
        |key: &str, kind: &str, value: &str| format!("<attr key=\"{key}\" type=\"{kind}\">{value}</attr>\n");
    let place = "/mainloop/Recorder/outInfo/";
    let about = [
        attribute("compression", "string", "LZ4"),
        attribute("originalModuleName", "string", "simulator"),
        attribute("originalOutputName", "string", "events"),
        attribute("typeDescription", "string", "Array of events (polarity ON/OFF)."),
        attribute("typeIdentifier", "string", "EVTS"),
    ]
    .concat();
    let sensor = [
        attribute("sizeX", "int", &size.width.to_string()),
        attribute("sizeY", "int", &size.height.to_string()),
        attribute("source", "string", "simulator"),
    ]
    .concat();
    format!(
        "<dv version=\"2.0\">\n<node name=\"outInfo\" path=\"{place}\">\n<node name=\"0\" path=\"{place}0/\">\n{about}\
         <node name=\"info\" path=\"{place}0/info/\">\n{sensor}</node>\n</node>\n</node>\n</dv>\n"
    )
}

/// The first stream of events. The error says what is missing.
pub(super) fn read_info(text: &str) -> Result<StreamInfo, String> {
    let document = parsed(text)?;
    let stream = first_stream(&document, "EVTS").ok_or("it has no stream of events")?;
    let id = node_number(stream).ok_or("the node of its event stream has no numeric name")?;
    let info = stream.children().find(|node| node.attribute("name") == Some("info"));
    let side = |key: &str| node_attribute(info?, key)?.trim().parse::<u32>().ok();
    let size =
        side("sizeX").zip(side("sizeY")).ok_or("it does not state the sensor's size (sizeX, sizeY)")?;
    Ok(StreamInfo { id, size: Size { width: size.0, height: size.1 } })
}

/// The number of the first stream of frames, whose packets state their own sizes.
pub(super) fn frame_stream(text: &str) -> Result<i32, String> {
    let document = parsed(text)?;
    let stream = first_stream(&document, "FRME").ok_or("it has no stream of frames")?;
    node_number(stream).ok_or_else(|| "the node of its stream of frames has no numeric name".to_owned())
}

fn parsed(text: &str) -> Result<Document<'_>, String> {
    Document::parse(text).map_err(|e| format!("its description is not valid XML: {e}"))
}

/// The stream of lowest number that holds this kind of buffer.
fn first_stream<'a, 'b>(document: &'a Document<'b>, kind: &str) -> Option<Node<'a, 'b>> {
    let streams = document.descendants().filter(|node| node_attribute(*node, "typeIdentifier") == Some(kind));
    streams.min_by_key(|node| node_number(*node))
}

fn node_number(node: Node<'_, '_>) -> Option<i32> {
    node.attribute("name")?.parse().ok()
}

/// The value of one of a node's own attributes, which are its children.
fn node_attribute<'a>(node: Node<'a, '_>, key: &str) -> Option<&'a str> {
    let is_it = |child: &Node<'_, '_>| child.has_tag_name("attr") && child.attribute("key") == Some(key);
    node.children().find(is_it)?.text()
}
