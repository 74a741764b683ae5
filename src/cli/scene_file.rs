//! `hapticd ctl scene`: the resident scene as a whole, shown, kept in a file, put back, watched.
//!
//! The file is TOML with the keys of `scene.proto`: what `show` prints, `load` takes back
//! unchanged. It has no device and no revision in it, so it fits any device.

use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use crate::client::Authorized;
use anyhow::{Context, bail};
use clap::{Args, Subcommand};
use serde_json::{Value, json};

use super::ctl::plain;
use super::object::counted;
use super::object_print::{object_json, understood};
use crate::config::{object_to_proto, read_scene_objects, write_scene_objects};
use crate::proto::scene_service_client::SceneServiceClient;
use crate::proto::{GetSceneRequest, ReplaceSceneRequest, Scene, WatchSceneRequest};

/// The resident scene as a whole
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd ctl scene show
  hapticd ctl scene save bench.toml
  hapticd ctl scene load bench.toml
  hapticd ctl scene watch")]
pub struct SceneCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Print it as a file
    #[command(after_help = "Examples:
  hapticd ctl scene show > bench.toml
  hapticd ctl scene show --json")]
    Show,
    /// Write it to a file
    #[command(after_help = "Example:
  hapticd ctl scene save bench.toml")]
    Save {
        /// Written over if it is there
        file: PathBuf,
    },
    /// Replace it by that of a file, all at once or not at all
    #[command(after_help = "Examples:
  hapticd ctl scene load bench.toml
  hapticd ctl scene load bench.toml --revision 7
  hapticd ctl scene show | sed s/2000/4000/ | hapticd ctl scene load -")]
    Load {
        /// `-`: standard input
        file: PathBuf,
        /// Only if the scene is at this revision still
        #[arg(long, value_name = "N")]
        revision: Option<std::num::NonZeroU64>,
    },
    /// Tell every change, until Ctrl-C
    #[command(after_help = "Examples:
  hapticd ctl scene watch
  hapticd ctl scene watch --json")]
    Watch,
}

impl SceneCommand {
    /// Does it and prints the answer.
    pub async fn run(
        self,
        scenes: &mut SceneServiceClient<Authorized>,
        device: &str,
        as_json: bool,
    ) -> anyhow::Result<()> {
        let name = format!("{device}/scene");
        match self.action {
            Action::Show => {
                let scene = get(scenes, name).await?;
                if as_json {
                    say!("{}", scene_json(&scene)?);
                } else {
                    say!("{}", scene_text(&scene)?.trim_end());
                }
                Ok(())
            }
            Action::Save { file } => {
                let scene = get(scenes, name).await?;
                let text = scene_text(&scene)?;
                write_whole(&file, &text)
                    .with_context(|| format!("cannot write {}", file.display()))?;
                say_done(&scene, as_json);
                Ok(())
            }
            Action::Load { file, revision } => {
                let objects = read_scene_objects(&read(&file)?, &file.display().to_string())?;
                let full = |id| format!("{name}/objects/{id}");
                let objects =
                    objects.iter().map(|object| object_to_proto(object, full(object.id())));
                let request = ReplaceSceneRequest {
                    objects: objects.collect(),
                    scene_revision: revision.map_or(0, Into::into),
                    name,
                };
                let scene = scenes.replace_scene(request).await.map_err(plain)?.into_inner();
                say_done(&scene, as_json);
                Ok(())
            }
            Action::Watch => watch(scenes, name, as_json).await,
        }
    }
}

async fn get(scenes: &mut SceneServiceClient<Authorized>, name: String) -> anyhow::Result<Scene> {
    Ok(scenes.get_scene(GetSceneRequest { name }).await.map_err(plain)?.into_inner())
}

/// In place of what was there only when it is whole: a full disk costs nothing.
fn write_whole(file: &Path, text: &str) -> std::io::Result<()> {
    if file.exists() && !file.is_file() {
        // A pipe or a terminal.
        return std::fs::write(file, text);
    }
    let mut beside = file.as_os_str().to_owned();
    beside.push(".new");
    let written = File::create(&beside).and_then(|mut new| {
        new.write_all(text.as_bytes())?;
        new.sync_all()
    });
    written.and_then(|()| std::fs::rename(&beside, file)).inspect_err(|_| {
        // What is half written is of no use to anybody.
        let _ = std::fs::remove_file(&beside);
    })
}

async fn watch(
    scenes: &mut SceneServiceClient<Authorized>,
    name: String,
    as_json: bool,
) -> anyhow::Result<()> {
    let request = WatchSceneRequest { name };
    let mut watched = scenes.watch_scene(request).await.map_err(plain)?.into_inner();
    loop {
        tokio::select! {
            scene = watched.message() => match scene.map_err(plain)? {
                Some(scene) if as_json => say!("{}", scene_json(&scene)?),
                Some(scene) => {
                    let changed = scene.objects.iter().filter(|o| o.revision == scene.revision);
                    let changed: Vec<_> = changed.filter_map(|o| o.name.rsplit('/').next()).collect();
                    let of = if changed.is_empty() { "" } else { ": " };
                    let count = counted(scene.objects.len());
                    say!("revision {}, {count}{of}{}", scene.revision, changed.join(", "));
                }
                None => bail!("the server ended"),
            },
            signal = tokio::signal::ctrl_c() => return Ok(signal?),
        }
    }
}

fn read(file: &Path) -> anyhow::Result<String> {
    let mut text = String::new();
    let read = if file.as_os_str() == "-" {
        std::io::stdin().read_to_string(&mut text)
    } else {
        std::fs::File::open(file).and_then(|mut file| file.read_to_string(&mut text))
    };
    read.with_context(|| format!("cannot read {}", file.display()))?;
    Ok(text)
}

fn scene_text(scene: &Scene) -> anyhow::Result<String> {
    let objects = scene.objects.iter().map(understood).collect::<Result<Vec<_>, _>>()?;
    let text = write_scene_objects(&objects)?;
    Ok(format!("# {}, revision {}\n{text}", scene.name, scene.revision))
}

fn scene_json(scene: &Scene) -> anyhow::Result<Value> {
    let objects = scene.objects.iter().map(object_json).collect::<Result<Vec<_>, _>>()?;
    Ok(json!({ "name": scene.name, "revision": scene.revision, "objects": objects }))
}

fn say_done(scene: &Scene, as_json: bool) {
    let (count, revision) = (scene.objects.len(), scene.revision);
    if as_json {
        say!("{}", json!({ "scene_revision": revision, "objects": count }));
    } else {
        say!("{}, revision {revision}", counted(count));
    }
}
