//! Tests of the writer: rotation, loss, disks that fail.

use std::os::unix::fs::PermissionsExt;

use super::super::tail;
use super::super::tests::QUIET;
use super::*;

fn lines(folder: &Path) -> Vec<Line> {
    let read = tail(folder, usize::MAX).unwrap();
    read.iter().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn detail(text: &str) -> Event<'_> {
    Event { what: What::SceneChanged, detail: text, ..QUIET }
}

#[test]
fn what_is_recorded_is_on_disk_when_it_is_closed_and_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    for run in 0..2 {
        let log = AuditLog::open(&folder.path().join("state")).unwrap();
        for i in 0..50 {
            log.record(&detail(&format!("{run} {i}")));
        }
        assert_eq!(log.lost(), 0);
    }
    let state = folder.path().join("state");
    let lines = lines(&state);
    let said: Vec<_> = lines.iter().map(|line| line.detail.as_str()).collect();
    let wanted: Vec<_> =
        (0..2).flat_map(|run| (0..50).map(move |i| format!("{run} {i}"))).collect();
    assert_eq!(said, wanted);
    assert!(lines.is_sorted_by(|a, b| a.time <= b.time));
    let mode = fs::metadata(state.join(FILE)).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o600);
}

#[test]
fn a_command_appends_beside_a_server() {
    let folder = tempfile::tempdir().unwrap();
    let log = AuditLog::open(folder.path()).unwrap();
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope
                .spawn(|| (0..50).for_each(|_| append(folder.path(), &detail("command")).unwrap()));
        }
        (0..50).for_each(|_| log.record(&detail("server")));
    });
    drop(log);
    let of = |who: &str| lines(folder.path()).iter().filter(|line| line.detail == who).count();
    assert_eq!((of("command"), of("server")), (100, 50));
}

#[test]
fn a_full_file_is_put_aside_and_three_of_them_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let length = Line::new(&detail("0000"), Utc::now()).to_json().len() as u64;
    let mut files = Files::new(folder.path(), 10 * length);
    for i in 0..65 {
        files.write(&Line::new(&detail(&format!("{i:04}")), Utc::now()).to_json()).unwrap();
    }
    let mut names: Vec<_> = fs::read_dir(folder.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(names, ["audit.jsonl", "audit.jsonl.1", "audit.jsonl.2", "audit.jsonl.3"]);
    for name in names {
        assert!(fs::metadata(folder.path().join(name)).unwrap().len() <= 10 * length);
    }
    let kept: Vec<_> = lines(folder.path()).iter().map(|line| line.detail.clone()).collect();
    let wanted: Vec<_> = (30..65).map(|i| format!("{i:04}")).collect();
    assert_eq!(kept, wanted, "the oldest go, and nothing else does");
}

/// The disk stands still: whoever records does not, and what is missing is a number.
#[test]
fn what_finds_no_room_is_counted_and_the_count_is_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let (to_writer, waiting) = sync_channel(4);
    let mut writer = Writer::new(Files::new(folder.path(), LARGEST_BYTES));
    let lost = Arc::clone(&writer.lost);
    let log = AuditLog { to_writer: Some(to_writer), lost, thread: None };
    for i in 0..10 {
        log.record(&detail(&i.to_string()));
    }
    assert_eq!(log.lost(), 6);
    drop(log);
    writer.run(&waiting);
    let lines = lines(folder.path());
    let said: Vec<_> = lines.iter().map(|line| (line.detail.as_str(), line.lost)).collect();
    assert_eq!(said, [("0", None), ("1", None), ("2", None), ("3", None), ("", Some(6))]);
}

#[test]
fn a_disk_that_fails_costs_lines_and_they_are_counted_when_it_is_back() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let log = AuditLog::open(&state).unwrap();
    log.record(&detail("before"));
    let until = |what: &str, happened: &dyn Fn() -> bool| {
        let deadline = Instant::now() + Duration::from_secs(30);
        while !happened() {
            assert!(Instant::now() < deadline, "{what}");
            std::thread::sleep(PAUSE);
        }
    };
    until("written", &|| tail(&state, 1).is_ok_and(|lines| lines.len() == 1));
    // No file can be made where there is no directory, whoever tries.
    fs::rename(&state, folder.path().join("away")).unwrap();
    for i in 1..=3 {
        log.record(&detail("lost"));
        until("counted", &|| log.lost() == i);
    }
    fs::rename(folder.path().join("away"), &state).unwrap();
    log.record(&detail("after"));
    drop(log);
    let said = lines(&state);
    let mut said: Vec<_> = said.iter().map(|line| (line.detail.as_str(), line.lost)).collect();
    // The count may be told before "after" comes.
    said.sort_unstable();
    assert_eq!(said, [("", Some(3)), ("after", None), ("before", None)]);
}

#[test]
fn half_a_line_spoils_no_other() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join(FILE), "{\"time\":\"2025-11-22T09:3").unwrap();
    append(folder.path(), &QUIET).unwrap();
    append(folder.path(), &QUIET).unwrap();
    let read = tail(folder.path(), 10).unwrap();
    assert_eq!(read.len(), 3);
    assert!(read[1..].iter().all(|line| serde_json::from_str::<Line>(line).is_ok()), "{read:?}");
}

#[test]
fn a_file_that_was_moved_away_is_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let mut files = Files::new(folder.path(), LARGEST_BYTES);
    files.write("1\n").unwrap();
    fs::rename(files.path(), folder.path().join("moved")).unwrap();
    files.write("2\n").unwrap();
    assert_eq!(tail(folder.path(), 9).unwrap(), ["2"]);
    fs::remove_file(files.path()).unwrap();
    files.write("3\n").unwrap();
    assert_eq!(tail(folder.path(), 9).unwrap(), ["3"]);
}

/// A stranger asks a thousand times a second, and what others did is still there.
#[test]
fn refusals_too_many_become_a_number() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = Writer::new(Files::new(folder.path(), LARGEST_BYTES));
    let refused = Event { what: What::Refused, who: "", ..QUIET };
    let mut now = Utc::from_ms(1_763_803_800_000);
    for _ in 0..90_000 {
        writer.take((Line::new(&refused, now), now));
        now = Utc::from_ms(now.ms() + 1);
    }
    let (_, none) = sync_channel(1);
    writer.run(&none);
    let lines = lines(folder.path());
    let told: Vec<_> = lines.iter().filter_map(|line| line.lost).collect();
    assert_eq!(told, [60_000 - REFUSALS, 30_000 - REFUSALS]);
    assert_eq!(lines.len() as u64, 2 * REFUSALS + 2);
    assert!(lines.iter().all(|line| line.what == Some(What::Refused)));
}

/// `/dev/full` takes nothing: the real error of a full disk.
#[test]
fn a_full_disk_is_told_once_and_stops_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = Writer::new(Files::new(folder.path(), u64::MAX));
    writer.files.open().unwrap();
    writer.files.path = "/dev/full".into();
    writer.files.file = Some(OpenOptions::new().append(true).open("/dev/full").unwrap());
    for _ in 0..3 {
        writer.put(&Line::new(&QUIET, Utc::now()));
        assert!(writer.failing);
    }
    assert_eq!(writer.lost.total.load(Ordering::Relaxed), 3);
    writer.files = Files::new(folder.path(), u64::MAX);
    writer.tell_lost(Utc::now());
    assert!(!writer.failing);
    assert_eq!(lines(folder.path())[0].lost, Some(3));
}
