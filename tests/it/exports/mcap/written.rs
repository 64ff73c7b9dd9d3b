//! The file itself: order, sums, indexes, statistics, names, and the description of the bag.

use super::recording::{Fields, McapFile, chunk, crc};
use super::{EPOCH_NS, TestExport, plane, recorded};
use std::collections::BTreeMap;

#[test]
fn topics_have_the_types_that_viewers_know() {
    let exported = TestExport::of(plane::centred(), "mcap", &["--window", "0..100000"]);
    let file = McapFile::read(&recorded(&exported));
    let found: BTreeMap<&str, &str> =
        file.channels.values().map(|c| (c.topic.as_str(), c.kind.as_str())).collect();
    let wanted = [
        ("/depth", "sensor_msgs/msg/Image"),
        ("/event_camera/events", "event_camera_msgs/msg/EventPacket"),
        ("/image/blurred", "sensor_msgs/msg/Image"),
        ("/image/camera_info", "sensor_msgs/msg/CameraInfo"),
        ("/image/image_raw", "sensor_msgs/msg/Image"),
        ("/pose", "geometry_msgs/msg/PoseStamped"),
        ("/tf", "tf2_msgs/msg/TFMessage"),
    ];
    assert_eq!(found, BTreeMap::from(wanted));
    for channel in file.channels.values() {
        assert_eq!((&*channel.schema_encoding, &*channel.message_encoding), ("ros2msg", "cdr"));
        // Each type that a definition uses is defined in it.
        let defined: Vec<&str> =
            channel.definition.lines().filter_map(|line| line.strip_prefix("MSG: ")).collect();
        for line in channel.definition.lines().filter(|line| !line.starts_with("MSG: ")) {
            let used = line.split_whitespace().next().unwrap().trim_end_matches("[]");
            assert!(!used.contains('/') || defined.contains(&used), "{}: {used}", channel.topic);
        }
    }
    let mut header = Fields::record(&file.of_kind(1)[0].content);
    assert_eq!(header.text(), "ros2");
}

#[test]
fn messages_are_in_order_and_indexed() {
    let exported = TestExport::of(plane::centred(), "mcap", &[]);
    let file = McapFile::read(&recorded(&exported));
    assert!(file.all().is_sorted_by_key(|message| message.log_time));
    for id in file.channels.keys() {
        let sequences = file.all().iter().filter(|m| m.channel == *id).map(|m| m.sequence);
        assert!(sequences.eq(0..file.all().iter().filter(|m| m.channel == *id).count() as u32));
    }
    let chunks = file.of_kind(6);
    let indexes = file.of_kind(8);
    assert!(chunks.len() > 3, "only {} chunks", chunks.len());
    assert_eq!(indexes.len(), chunks.len());
    let mut indexed = 0;
    for (index, stored) in indexes.iter().zip(&chunks) {
        let mut fields = Fields::record(&index.content);
        let span = [fields.u64() as i64, fields.u64() as i64];
        assert_eq!([fields.u64() as usize, fields.u64() as usize], [stored.at, stored.content.len() + 9]);
        let records = chunk(stored);
        let mut places = Fields::record(fields.list());
        let length = fields.u64() as usize;
        let mut end = stored.at + stored.content.len() + 9;
        while !places.is_at_end() {
            let (channel, at) = (places.u16(), places.u64() as usize);
            assert_eq!(at, end);
            let own = file.records.iter().find(|record| record.at == at).unwrap();
            end += own.content.len() + 9;
            let mut entries = Fields::record(&own.content);
            assert_eq!((own.opcode, entries.u16()), (7, channel));
            let mut entries = Fields::record(entries.list());
            while !entries.is_at_end() {
                let (time, offset) = (entries.u64() as i64, entries.u64() as usize);
                let mut message = Fields::record(&records[offset + 9..]);
                assert_eq!((records[offset], message.u16()), (5, channel));
                message.u32();
                assert_eq!(message.u64() as i64, time);
                assert!((span[0]..=span[1]).contains(&time));
                indexed += 1;
            }
        }
        assert_eq!(end - (stored.at + stored.content.len() + 9), length);
        assert_eq!(fields.text(), "zstd");
        fields.u64();
        assert_eq!(fields.u64() as usize, records.len());
        assert!(fields.is_at_end());
    }
    assert_eq!(indexed, file.all().len());
}

#[test]
fn sums_and_statistics_hold() {
    let exported = TestExport::of(plane::centred(), "mcap", &[]);
    let file = McapFile::read(&recorded(&exported));
    let end = file.of_kind(0x0f)[0];
    assert_eq!(Fields::record(&end.content).u32(), crc(&file.bytes[..end.at]));
    let footer = file.of_kind(2)[0];
    let mut fields = Fields::record(&footer.content);
    let [summary, offsets] = [fields.u64() as usize, fields.u64() as usize];
    assert_eq!(summary, end.at + 9 + 4);
    assert_eq!(fields.u32(), crc(&file.bytes[summary..footer.at + 9 + 16]));
    assert_eq!(file.of_kind(0x0e)[0].at, offsets);
    for offset in file.of_kind(0x0e) {
        let mut fields = Fields::record(&offset.content);
        let (opcode, start, length) = (fields.u8(), fields.u64() as usize, fields.u64() as usize);
        let group = file.records.iter().filter(|r| (start..start + length).contains(&r.at));
        assert!(group.clone().count() > 0 && group.clone().all(|record| record.opcode == opcode));
    }
    let mut fields = Fields::record(&file.of_kind(0x0b)[0].content);
    assert_eq!(fields.u64() as usize, file.all().len());
    assert_eq!((usize::from(fields.u16()), fields.u32() as usize), (5, file.channels.len()));
    assert_eq!([fields.u32(), fields.u32()], [0, 1]);
    assert_eq!(fields.u32() as usize, file.of_kind(6).len());
    let times = [file.all()[0].log_time, file.all().last().unwrap().log_time];
    assert_eq!([fields.u64() as i64, fields.u64() as i64], times);
    assert_eq!(times[0], EPOCH_NS);
    let mut counts = Fields::record(fields.list());
    while !counts.is_at_end() {
        let (id, count) = (counts.u16(), counts.u64() as usize);
        assert_eq!(count, file.all().iter().filter(|message| message.channel == id).count());
    }
    let metadata = file.of_kind(0x0c)[0];
    let mut fields = Fields::record(&file.of_kind(0x0d)[0].content);
    assert_eq!([fields.u64() as usize, fields.u64() as usize], [metadata.at, metadata.content.len() + 9]);
    assert_eq!(fields.text(), "gs2e");
}

/// rosbag2 opens the folder by `metadata.yaml`.
#[test]
fn the_folder_is_a_bag() {
    let exported = TestExport::of(plane::centred(), "mcap", &["--window", "0..100000"]);
    let file = McapFile::read(&recorded(&exported));
    let bag: serde_json::Value = serde_saphyr::from_str(&exported.text("metadata.yaml")).unwrap();
    let bag = &bag["rosbag2_bagfile_information"];
    assert_eq!((&bag["storage_identifier"], &bag["version"]), (&"mcap".into(), &5.into()));
    let name = recorded(&exported).file_name().unwrap().to_str().unwrap().to_owned();
    assert_eq!(
        (&bag["relative_file_paths"][0], &bag["files"][0]["path"]),
        (&name.clone().into(), &name.into())
    );
    assert_eq!(bag["message_count"], file.all().len());
    assert_eq!(bag["duration"]["nanoseconds"], file.all().last().unwrap().log_time - EPOCH_NS);
    assert_eq!(bag["starting_time"]["nanoseconds_since_epoch"], EPOCH_NS);
    for topic in bag["topics_with_message_count"].as_array().unwrap() {
        let name = topic["topic_metadata"]["name"].as_str().unwrap();
        assert_eq!(topic["message_count"], file.messages(name).len(), "{name}");
        assert_eq!(topic["topic_metadata"]["serialization_format"], "cdr");
    }
    assert_eq!(exported.json("export.json")["facts"]["messages"]["/tf"], file.messages("/tf").len());
}
