//! A release from an untrusted source.

use crate::inputs::recipe;
use crate::{Bomb, Fate, Place};
use parquet::basic::{Compression, ZstdLevel};
use parquet::column::writer::ColumnWriter;
use parquet::data_type::ByteArray;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use sha2::{Digest as _, Sha256};
use std::sync::Arc;

pub(crate) const BOMBS: &[Bomb] = &[
    Bomb {
        name: "parquet-rows",
        what: "an index.parquet of 3,000,000 equal rows",
        args: "audit out",
        fate: Fate::Refused,
        make: |place| index(place, 3_000_000, "a"),
    },
    Bomb {
        name: "parquet-text",
        what: "an index.parquet of 20,000 times one text of 60 kB",
        args: "audit out",
        fate: Fate::Refused,
        make: |place| index(place, 20_000, &"x".repeat(60_000)),
    },
];

/// Makes a release whose index has `rows` rows of one text, and whose sums match that index.
fn index(place: &Place, rows: usize, text: &str) {
    recipe(place, "");
    place.ok("release --to out r.yaml");
    std::fs::remove_dir_all(place.path(".gs2e")).unwrap();
    let bytes = parquet(rows, text);
    let digest =
        |bytes: &[u8]| -> String { Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect() };
    let (file, sums) = (place.path("out/index.parquet"), place.path("out/SHA256SUMS"));
    let was = digest(&std::fs::read(&file).unwrap());
    let changed = std::fs::read_to_string(&sums).unwrap().replace(&was, &digest(&bytes));
    for (path, content) in [(file, bytes), (sums, changed.into_bytes())] {
        std::fs::remove_file(&path).unwrap();
        std::fs::write(path, content).unwrap();
    }
}

fn parquet(rows: usize, text: &str) -> Vec<u8> {
    let names: String = (0..10).map(|k| format!("required binary c{k} (STRING);")).collect();
    let schema = Arc::new(parse_message_type(&format!("message rows {{ {names} }}")).unwrap());
    let zstd = Compression::ZSTD(ZstdLevel::default());
    let properties = WriterProperties::builder().set_compression(zstd).set_dictionary_enabled(true).build();
    let mut file = SerializedFileWriter::new(Vec::new(), schema, Arc::new(properties)).unwrap();
    let mut group = file.next_row_group().unwrap();
    let block = vec![ByteArray::from(text); 10_000];
    while let Some(mut column) = group.next_column().unwrap() {
        let ColumnWriter::ByteArrayColumnWriter(writer) = column.untyped() else { panic!("texts") };
        for _ in 0..rows / block.len() {
            writer.write_batch(&block, None, None).unwrap();
        }
        column.close().unwrap();
    }
    group.close().unwrap();
    file.into_inner().unwrap()
}
