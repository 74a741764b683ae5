//! The state directory: one server at a time, and the scene of each device in a TOML file.
//!
//! ```text
//! STATE_DIR/lock                        held as long as the server lives
//! STATE_DIR/devices/NAME/scene.toml     the scene; people may read it, and edit it between runs
//! ```
//!
//! A save is atomic: a temporary file in the same directory is written and synced, takes the
//! place of the old one, and the directory is synced; only then is the change acknowledged.
//! So after a crash the file holds the last acknowledged scene, or one that was about to be.
//! A file that cannot be understood is an error and is never written over. Its last line says
//! that it is whole, so that one cut short is not taken for a smaller scene.

use std::fs::{self, File, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use super::scene_layout::{LAST_LINE, SceneTextError, read_scene, write_scene};
use super::{ConfigError, Id, Scene};

const SCENE: &str = "scene.toml";
const TEMPORARY: &str = "scene.toml.new";

/// Why the state on disk cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum StateError {
    /// The system refuses.
    #[error("{path}: {action}: {source}")]
    Io {
        /// File or directory.
        path: String,
        /// What was tried.
        action: &'static str,
        /// What the system said.
        source: io::Error,
    },
    /// Another server is using the directory.
    #[error(
        "{path}: another hapticd is using this state directory; stop it or choose another --state-dir"
    )]
    InUse {
        /// The directory.
        path: String,
    },
    /// A file was cut short.
    #[error(
        "{path}: the last line is not {LAST_LINE:?}: the file was cut short; nothing was changed"
    )]
    CutShort {
        /// The file.
        path: String,
    },
    /// A file cannot be understood.
    #[error("{0}; the file was left as it is")]
    Malformed(ConfigError),
}

/// The directory of one running server, locked while this value lives.
#[derive(Debug)]
pub struct StateDir {
    path: PathBuf,
    _lock: File,
}

impl StateDir {
    /// Makes the directory where it is missing, and takes its lock.
    pub fn open(path: impl Into<PathBuf>) -> Result<Self, StateError> {
        let path = path.into();
        make_directory(&path).map_err(io_error(&path, "cannot make the directory"))?;
        let lock_path = path.join("lock");
        let mut options = File::options();
        let lock = options.write(true).create(true).truncate(false).open(&lock_path);
        let lock = lock.map_err(io_error(&lock_path, "cannot open"))?;
        match lock.try_lock() {
            Ok(()) => Ok(Self { path, _lock: lock }),
            Err(TryLockError::WouldBlock) => {
                Err(StateError::InUse { path: path.display().to_string() })
            }
            Err(TryLockError::Error(source)) => Err(io_error(&lock_path, "cannot lock")(source)),
        }
    }

    /// Where the server keeps what it has to remember.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The scene file of a device, with the scene in it.
    pub fn scene(&self, device: &Id) -> Result<(SceneFile, Scene), StateError> {
        SceneFile::open(self.path.join("devices").join(device.as_str()))
    }
}

/// The file of one scene. It has one owner, who saves one scene at a time.
#[derive(Debug)]
pub struct SceneFile {
    directory: PathBuf,
    path: PathBuf,
    temporary: PathBuf,
}

impl SceneFile {
    /// Makes the directory where it is missing and reads the scene; an empty one at revision
    /// 1 where there is no file. What an interrupted save left behind is removed.
    pub fn open(directory: impl Into<PathBuf>) -> Result<(Self, Scene), StateError> {
        let directory = directory.into();
        make_directory(&directory).map_err(io_error(&directory, "cannot make the directory"))?;
        let (path, temporary) = (directory.join(SCENE), directory.join(TEMPORARY));
        match fs::remove_file(&temporary) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                return Err(io_error(&temporary, "cannot remove")(error));
            }
            _ => {}
        }
        let scene = match fs::read_to_string(&path) {
            Ok(text) => read_at(&path, &text)?,
            Err(error) if error.kind() == io::ErrorKind::NotFound => Scene::default(),
            Err(error) => return Err(io_error(&path, "cannot read")(error)),
        };
        Ok((Self { directory, path, temporary }, scene))
    }

    /// Puts the scene in place of the one on disk. On an error before the change of names the
    /// old one is still there.
    pub fn save(&mut self, scene: &Scene) -> Result<(), StateError> {
        let text = write_scene(scene).map_err(|error| {
            io_error(&self.path, "cannot be written as TOML")(io::Error::other(error))
        })?;
        write_synced(&self.temporary, &text).map_err(io_error(&self.temporary, "cannot write"))?;
        fs::rename(&self.temporary, &self.path).map_err(io_error(&self.path, "cannot replace"))?;
        let directory = File::open(&self.directory).and_then(|directory| directory.sync_all());
        directory.map_err(io_error(&self.directory, "cannot sync"))
    }
}

fn read_at(path: &Path, text: &str) -> Result<Scene, StateError> {
    let path = path.display().to_string();
    read_scene(text, &path).map_err(|error| match error {
        SceneTextError::CutShort => StateError::CutShort { path },
        SceneTextError::Malformed(error) => StateError::Malformed(error),
    })
}

/// Makes a directory that a loss of power does not take away again.
fn make_directory(path: &Path) -> io::Result<()> {
    if path.is_dir() {
        return Ok(());
    }
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty());
    let parent = parent.unwrap_or(Path::new("."));
    make_directory(parent)?;
    match fs::create_dir(path) {
        Err(error) if !path.is_dir() => Err(error),
        _ => File::open(parent)?.sync_all(),
    }
}

fn write_synced(path: &Path, text: &str) -> io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(text.as_bytes())?;
    file.sync_all()
}

fn io_error(path: &Path, action: &'static str) -> impl FnOnce(io::Error) -> StateError {
    let path = path.display().to_string();
    move |source| StateError::Io { path, action, source }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use nalgebra::{Quaternion, Vector3};

    use super::super::scene::tests::wall;
    use super::*;
    use crate::config::{ObjectKind, SceneObject};
    use crate::environment::Material;

    /// A scene with surfaces and a field, with awkward numbers.
    fn scene() -> Scene {
        let mut scene = Scene::default();
        let material = Material {
            stiffness_N_per_m: 0.1 + 0.2,
            damping_Ns_per_m: 1e-7,
            kinetic_friction: 1.0 / 3.0,
            static_friction: 2.0 / 3.0,
            surface_velocity_W_m_per_s: Vector3::new(0.0, 1e-300, -0.7),
        };
        let orientation = Quaternion::new(0.1, 0.2, 0.3, 0.4).normalize();
        let kinds = [
            (ObjectKind::Constant { force_N: Vector3::new(-0.0, 1e-300, -999.9) }, None),
            (ObjectKind::Viscous { damping_Ns_per_m: 5.0 }, None),
            (
                ObjectKind::Sphere { centre_m: Vector3::new(0.1, 0.2, 0.3), radius_m: 0.05 },
                Some(material),
            ),
            (
                ObjectKind::Box {
                    centre_m: Vector3::x(),
                    half_extents_m: Vector3::new(1.0, 2.0, 3.0),
                    orientation,
                },
                Some(material),
            ),
        ];
        for (i, (kind, material)) in kinds.into_iter().enumerate() {
            let id = Id::parse("id", &format!("o{i}")).unwrap();
            let object = SceneObject::new(id, kind, material, material.is_some()).unwrap();
            scene.create(object, None).unwrap();
        }
        scene.delete("o1", None).unwrap();
        scene.create(wall("wall", 0.3), None).unwrap();
        scene.delete("o0", None).unwrap();
        scene
    }

    fn directory() -> tempfile::TempDir {
        tempfile::tempdir().unwrap()
    }

    #[test]
    fn a_saved_scene_reads_back_bit_by_bit() {
        let directory = directory();
        let (mut file, empty) = SceneFile::open(directory.path()).unwrap();
        assert_eq!((empty.revision(), empty.list().count()), (1, 0));
        for scene in [scene(), Scene::default(), scene()] {
            file.save(&scene).unwrap();
            let (_, read) = SceneFile::open(directory.path()).unwrap();
            assert_eq!(read, scene);
            assert_eq!(read.items(), scene.items());
        }
    }

    #[test]
    fn a_file_cut_short_at_any_byte_is_refused_and_kept() {
        let directory = directory();
        let (mut file, _) = SceneFile::open(directory.path()).unwrap();
        file.save(&scene()).unwrap();
        let whole = fs::read(&file.path).unwrap();
        for length in 0..whole.len() - 1 {
            fs::write(&file.path, &whole[..length]).unwrap();
            assert!(SceneFile::open(directory.path()).is_err(), "cut to {length} bytes");
            assert_eq!(fs::read(&file.path).unwrap(), whole[..length]);
        }
    }

    #[test]
    fn a_malformed_file_names_itself_and_the_reason_and_is_kept() {
        let directory = directory();
        let (mut file, _) = SceneFile::open(directory.path()).unwrap();
        file.save(&scene()).unwrap();
        let text = fs::read_to_string(&file.path).unwrap();
        for (from, to, named) in [
            ("radius_m = 0.05", "radius_m = -0.05", "object[1].sphere.radius_m = -0.05"),
            ("friction = 0.3", "friction = nan # 0.3", "friction = NaN"),
            ("friction = 0.6", "friction = 0.1 # ", "static_friction = 0.1: must be at least"),
            ("orientation = [", "orientation = [0, 0, 0, 0] # ", "object[2].box.orientation = 0"),
            ("slot = 2", "slot = 300", "slot = 300"),
            ("slot = 2", "slot = 1", "slot = 1"),
            ("id = \"wall\"", "id = \"o3\"", "id = o3"),
            ("id = \"wall\"", "id = \"../x\"", "id = \"../x\""),
            ("revision = 8", "revision = 1", "revision"),
            ("revision = 8", "revision = 0", "revision = 0"),
            ("radius_m", "radius_mm", "radius_mm"),
            (
                "[object.sphere]",
                "[object.viscous]\ndamping_ns_per_m = 1\n[object.sphere]",
                "object[1].kind",
            ),
        ] {
            assert!(text.contains(from), "{from} in\n{text}");
            let broken = text.replacen(from, to, 1);
            fs::write(&file.path, &broken).unwrap();
            let error = SceneFile::open(directory.path()).unwrap_err().to_string();
            assert!(error.contains("scene.toml") && error.contains(named), "{error}");
            assert_eq!(fs::read_to_string(&file.path).unwrap(), broken);
        }
    }

    /// What the first releases wrote: one friction, and no more kinds than four.
    #[test]
    fn a_scene_written_before_is_still_read() {
        let directory = directory();
        let text = "# A scene of hapticd. Edit it only while the server is stopped.\n\
            revision = 3\n\n[[object]]\nid = \"table\"\nslot = 0\nrevision = 2\nhollow = false\n\n\
            [object.half_space]\npoint_m = [0.0, 0.4, 0.0]\nnormal = [0.0, -1.0, 0.0]\n\n\
            [object.material]\nstiffness_n_per_m = 5000.0\ndamping_ns_per_m = 1.0\n\
            friction = 0.25\n# end of scene\n";
        fs::write(directory.path().join(SCENE), text).unwrap();
        let (mut file, scene) = SceneFile::open(directory.path()).unwrap();
        let material = *scene.get("table").unwrap().material().unwrap();
        let expected = Material {
            stiffness_N_per_m: 5000.0,
            damping_Ns_per_m: 1.0,
            ..Material::default().with_friction(0.25)
        };
        assert_eq!((scene.revision(), material), (3, expected));
        file.save(&scene).unwrap();
        assert_eq!(SceneFile::open(directory.path()).unwrap().1, scene);
        let both = text.replace("friction = 0.25", "friction = 0.25\nkinetic_friction = 0.25");
        fs::write(directory.path().join(SCENE), both).unwrap();
        let error = SceneFile::open(directory.path()).unwrap_err().to_string();
        assert!(error.contains("object[0].material.friction = 0.25: means"), "{error}");
    }

    #[test]
    fn what_an_interrupted_save_left_is_ignored_and_removed() {
        let directory = directory();
        let (mut file, _) = SceneFile::open(directory.path()).unwrap();
        file.save(&scene()).unwrap();
        fs::write(&file.temporary, "revision = 99").unwrap();
        let (_, read) = SceneFile::open(directory.path()).unwrap();
        assert_eq!(read, scene());
        assert!(!file.temporary.exists());
    }

    #[test]
    fn a_save_that_fails_keeps_the_old_scene() {
        let directory = directory();
        let (mut file, _) = SceneFile::open(directory.path()).unwrap();
        file.save(&scene()).unwrap();
        fs::create_dir(&file.temporary).unwrap();
        let error = file.save(&Scene::default()).unwrap_err();
        assert!(matches!(error, StateError::Io { action: "cannot write", .. }), "{error}");
        fs::remove_dir(&file.temporary).unwrap();
        assert_eq!(SceneFile::open(directory.path()).unwrap().1, scene());
    }

    #[test]
    fn a_directory_that_cannot_be_written_is_a_typed_error() {
        let directory = directory();
        let path = directory.path().join("kept");
        let (mut file, _) = SceneFile::open(&path).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o555)).unwrap();
        // Root may write anyway: then there is no error to see here.
        if File::create(path.join("probe")).is_err() {
            let error = file.save(&scene()).unwrap_err();
            assert!(matches!(error, StateError::Io { .. }), "{error}");
        }
        let not_a_directory = directory.path().join("file");
        fs::write(&not_a_directory, "").unwrap();
        let error = SceneFile::open(&not_a_directory).unwrap_err();
        assert!(matches!(error, StateError::Io { .. }), "{error}");
        assert!(matches!(StateDir::open(&not_a_directory), Err(StateError::Io { .. })));
    }

    #[test]
    fn two_servers_never_share_a_state_directory() {
        let directory = directory();
        let device = Id::parse("device", "cho-2005").unwrap();
        let first = StateDir::open(directory.path()).unwrap();
        let (mut file, _) = first.scene(&device).unwrap();
        file.save(&scene()).unwrap();
        let error = StateDir::open(directory.path()).unwrap_err();
        assert!(
            matches!(error, StateError::InUse { .. }) && error.to_string().contains("--state-dir")
        );
        drop(first);
        let second = StateDir::open(directory.path()).unwrap();
        assert_eq!(second.scene(&device).unwrap().1, scene());
        assert!(directory.path().join("devices/cho-2005/scene.toml").exists());
    }
}
