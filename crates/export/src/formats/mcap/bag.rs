//! `metadata.yaml`, by which rosbag2 opens the folder as a bag (GitHub ros2/rosbag2, version 5 of the file,
//! which later versions read).

use super::recording::{WrittenRecording, WrittenTopic};

/// Name of the file.
pub(super) const NAME: &str = "metadata.yaml";

/// The file for a recording of this name. Names of topics and types, and that of the file, have letters,
/// digits and `/_-.` only, so they need no quotes.
pub(super) fn describe(name: &str, written: &WrittenRecording) -> String {
    let [first, last] = written.span_ns;
    let messages: u64 = written.topics.iter().map(|topic| topic.messages).sum();
    let span = |indent: &str| {
        format!(
            "{indent}duration:\n{indent}  nanoseconds: {}\n{indent}starting_time:\n\
             {indent}  nanoseconds_since_epoch: {first}\n{indent}message_count: {messages}\n",
            last - first
        )
    };
    let mut text = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n".to_owned();
    text += &span("  ");
    text += "  topics_with_message_count:\n";
    for WrittenTopic { name, kind, messages } in &written.topics {
        let lines = format!(
            "    - topic_metadata:\n        name: {name}\n        type: {kind}\n        \
             serialization_format: cdr\n        offered_qos_profiles: \"\"\n      message_count: {messages}\n"
        );
        text += &lines;
    }
    text += "  compression_format: \"\"\n  compression_mode: \"\"\n";
    text += &format!("  relative_file_paths:\n    - {name}\n  files:\n    - path: {name}\n");
    text + &span("      ")
}
