//! Tests of the file: what is kept, what is refused, and two at once.

use std::os::unix::fs::PermissionsExt;

use super::*;
use crate::credentials::Denied;

const NOW: Utc = Utc::LAST;

fn wanted(name: &str) -> Wanted {
    let name = name.to_owned();
    Wanted { name, grant: Grant::Observer, device: None, days: None, replace: false }
}

fn empty() -> (tempfile::TempDir, CredentialFile) {
    let folder = tempfile::tempdir().unwrap();
    let file = CredentialFile::in_directory(&folder.path().join("state"));
    (folder, file)
}

fn text(file: &CredentialFile) -> String {
    fs::read_to_string(&file.path).unwrap()
}

#[test]
fn what_is_issued_is_judged_until_it_is_revoked() {
    let (_folder, file) = empty();
    assert_eq!(file.load().unwrap(), Credentials::default());
    let (anna, _) = file.issue(wanted("anna"), NOW).unwrap();
    let narrow = Wanted { device: Some("devices/left".into()), days: Some(2), ..wanted("bob") };
    let noon = Utc::from_ms(1_763_812_800_500);
    let (bob, made) = file.issue(narrow, noon).unwrap();
    let times = made.expires.map(|expires| format!("{} {expires}", made.issued));
    assert_eq!(times.unwrap(), "2025-11-22T12:00:00Z 2025-11-24T12:00:00Z");

    let all = file.load().unwrap();
    assert_eq!(all.get("bob"), Some(&made));
    assert_eq!(all.judge(anna.as_str(), NOW).unwrap().name, "anna");
    assert_eq!(all.judge(bob.as_str(), noon).unwrap().device.unwrap(), "devices/left");
    for token in [anna.as_str(), bob.as_str()] {
        assert!(!text(&file).contains(token), "only hashes are kept");
    }
    assert_eq!(file.revoke("anna").unwrap().name, "anna");
    let all = file.load().unwrap();
    assert_eq!(all.judge(anna.as_str(), NOW), Err(Denied::Unknown));
    assert_eq!(all.list().len(), 1);
}

#[test]
fn a_name_is_given_once_unless_it_is_replaced() {
    let (_folder, file) = empty();
    let (first, _) = file.issue(wanted("anna"), NOW).unwrap();
    let before = text(&file);
    let said = file.issue(wanted("anna"), NOW).unwrap_err().to_string();
    assert!(said.contains("name = anna") && said.contains("--replace"), "{said}");
    assert_eq!(text(&file), before);
    let again = Wanted { replace: true, ..wanted("anna") };
    let (second, _) = file.issue(again, NOW).unwrap();
    let all = file.load().unwrap();
    assert!(all.judge(second.as_str(), NOW).is_ok() && all.judge(first.as_str(), NOW).is_err());
    let said = file.revoke("bob").unwrap_err().to_string();
    assert_eq!(said, "name = bob: no such credential; there are: anna");
    for name in ["", "../x", "a b"] {
        assert!(file.issue(wanted(name), NOW).is_err() && file.revoke(name).is_err());
    }
}

#[test]
fn the_file_is_readable_by_its_owner_alone_and_no_other_may_write_it() {
    let (_folder, file) = empty();
    file.issue(wanted("anna"), NOW).unwrap();
    for path in [&file.path, &file.lock] {
        assert_eq!(fs::metadata(path).unwrap().mode() & 0o777, 0o600, "{path:?}");
    }
    fs::set_permissions(&file.path, PermissionsExt::from_mode(0o644)).unwrap();
    file.load().unwrap();
    for mode in [0o620, 0o602] {
        fs::set_permissions(&file.path, PermissionsExt::from_mode(mode)).unwrap();
        let said = file.load().unwrap_err().to_string();
        assert!(said.contains(&format!("mode = {mode:03o}")), "{said}");
    }
}

#[test]
fn what_cannot_be_understood_is_named_and_never_written_over() {
    let (_folder, file) = empty();
    file.issue(wanted("anna"), NOW).unwrap();
    let whole = text(&file);
    let path = file.path.display().to_string();
    let write = |text: &[u8]| fs::write(&file.path, text).unwrap();
    for (broken, named) in [
        (whole.replace("observer", "root"), "credential[0].role = \"root\": must be"),
        (whole.replace("issued", "isued"), ":6: credential[0].isued: unknown field"),
        (whole.replace("[[credential]]", "[[credential]"), ":4: "),
        (whole.replace(LAST_LINE, ""), "cut short"),
        (String::new(), "cut short"),
        ("#".repeat(LARGEST_BYTES as usize + 1), "size = 524289: must be at most 524288 bytes"),
    ] {
        write(broken.as_bytes());
        let refusals = [
            file.load().unwrap_err(),
            file.issue(wanted("bob"), NOW).unwrap_err(),
            file.revoke("anna").unwrap_err(),
        ];
        for said in refusals.map(|error| error.to_string()) {
            assert!(said.starts_with(&path) && said.contains(named), "{said}");
            assert!(said.ends_with("left as it is"), "{said}");
        }
        assert_eq!(text(&file), broken);
    }
    write(&[b'#', 0xff]);
    assert!(file.issue(wanted("bob"), NOW).is_err());
    assert_eq!(fs::read(&file.path).unwrap(), [b'#', 0xff]);
}

#[test]
fn a_file_cut_short_at_any_byte_is_refused() {
    let (_folder, file) = empty();
    file.issue(wanted("anna"), NOW).unwrap();
    file.issue(wanted("bob"), NOW).unwrap();
    let whole = text(&file);
    for length in 0..whole.len() - 1 {
        fs::write(&file.path, &whole[..length]).unwrap();
        assert!(file.load().is_err(), "cut to {length} bytes");
    }
}

#[test]
fn all_that_there_may_be_are_read_again() {
    let (_folder, file) = empty();
    let mut all = Credentials::default();
    for i in 0..super::super::MAX_CREDENTIALS {
        let token = Token::random().unwrap();
        let device = Some(format!("devices/{}", "d".repeat(63)));
        let entry = super::super::list::tests::credential(&format!("{i:0>64}"), &token);
        all.put(Credential { device, expires: Some(NOW), issued: NOW, ..entry }).unwrap();
    }
    fs::create_dir_all(file.path.parent().unwrap()).unwrap();
    let text = format!("{FIRST_LINES}{}{LAST_LINE}\n", all.to_toml().unwrap());
    private::replace(&file.path, &text).unwrap();
    assert_eq!(file.load().unwrap(), all);
    assert!(file.issue(wanted("more"), NOW).is_err());
    file.revoke(&format!("{:0>64}", 7)).unwrap();
    file.issue(wanted("more"), NOW).unwrap();
}

/// Killed between writing and the change of names: the old list counts, and the next change
/// is not kept from its place.
#[test]
fn what_an_interrupted_change_left_beside_does_not_count() {
    let (_folder, file) = empty();
    let (anna, _) = file.issue(wanted("anna"), NOW).unwrap();
    let before = text(&file);
    let beside = private::beside(&file.path);
    fs::write(&beside, before.replace("anna", "mallory")).unwrap();
    assert_eq!(file.load().unwrap().judge(anna.as_str(), NOW).unwrap().name, "anna");
    file.issue(wanted("bob"), NOW).unwrap();
    let names: Vec<_> =
        file.load().unwrap().list().iter().map(|entry| entry.name.clone()).collect();
    assert_eq!(names, ["anna", "bob"]);
    assert!(!beside.exists());
    fs::create_dir(&beside).unwrap();
    let before = text(&file);
    file.issue(wanted("carl"), NOW).unwrap_err();
    assert_eq!(text(&file), before);
}

#[test]
fn of_many_at_once_none_loses_what_another_made() {
    let (_folder, file) = empty();
    let rounds = 25;
    std::thread::scope(|scope| {
        for issuer in ["a", "b", "c"] {
            let file = file.clone();
            scope.spawn(move || {
                for i in 0..rounds {
                    file.issue(wanted(&format!("{issuer}{i}")), NOW).unwrap();
                    if i % 5 == 4 {
                        file.revoke(&format!("{issuer}{}", i - 1)).unwrap();
                    }
                }
            });
        }
    });
    assert_eq!(file.load().unwrap().list().len(), 3 * (rounds - rounds / 5));
}
