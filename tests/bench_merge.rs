//! The table of what developing a bracket costs, on small frames: every part of it is there. Times are not judged.
#![allow(clippy::unwrap_used)]

use rigd::pipeline::decode::decode;
use rigd::study::bench::merging::{heading, line, run};

#[test]
fn the_table_has_every_part_and_leaves_the_frames_for_others() {
    let folder = tempfile::tempdir().unwrap();
    let mut lines = Vec::new();
    run((700, 480), 2, folder.path(), &mut |finding| {
        lines.push(line(finding));
        Ok(())
    })
    .unwrap();
    println!("{}\n{}", heading((700, 480)), lines.join("\n"));
    let parts =
        ["peak memory", "decode one JPEG", "inverse-variance", "poisson", "debevec", "robertson", "to EXR on disk"];
    for part in parts {
        assert_eq!(lines.iter().filter(|line| line.contains(part)).count(), 1, "{part}");
    }
    let frame = decode(&std::fs::read(folder.path().join("05.jpg")).unwrap()).unwrap();
    assert_eq!((frame.width, frame.height), (700, 480));
    let list = std::fs::read_to_string(folder.path().join("exposures.toml")).unwrap();
    assert_eq!(list.matches("[[frame]]").count(), 10);
}
