//! The memory card with its DCIM folders, and the files held in memory for the host.

use crate::codes::format;
use crate::pack::{Pack, count};
use crate::sensor::{Picture, PictureKind};

/// Storage id of the card.
pub(crate) const CARD: u32 = 0x0002_0001;
/// What PTP calls "all" in a parameter, and the root folder as a parent.
pub(crate) const ALL: u32 = 0xffff_ffff;
const DCIM: u32 = 0x9000_0000;
const FILES_A_FOLDER: u32 = 9999;

/// A file or a folder.
#[derive(Clone, Debug)]
pub(crate) struct Object {
    pub(crate) handle: u32,
    /// The card, or 0 for a file in memory.
    pub(crate) storage: u32,
    pub(crate) parent: u32,
    pub(crate) name: String,
    pub(crate) format: u16,
    pub(crate) bytes: Vec<u8>,
}

impl Object {
    /// The ObjectInfo data set (PTP, ISO 15740, section 5.5.2). The body's clock is not simulated: dates are empty.
    pub(crate) fn info(&self) -> Vec<u8> {
        let folder = self.format == format::FOLDER;
        Pack::default()
            .u32(self.storage)
            .u16(self.format)
            .u16(0)
            .u32(count(self.bytes.len()))
            .u16(0)
            .bytes(&[0; 12]) // no thumbnail
            .bytes(&[0; 12]) // width, height and depth are in the file
            .u32(self.parent)
            .u16(folder.into())
            .u32(0)
            .u32(0)
            .string(&self.name)
            .string("")
            .string("")
            .string("")
            .0
    }
}

/// Everything that has a handle.
#[derive(Debug)]
pub(crate) struct Store {
    objects: Vec<Object>,
    /// Files the card takes.
    capacity: u32,
    next_handle: u32,
}

impl Store {
    pub(crate) fn new(capacity: u32) -> Self {
        let mut store = Self { objects: Vec::new(), capacity, next_handle: DCIM };
        let dcim = store.add(CARD, 0, "DCIM".into(), format::FOLDER, Vec::new());
        store.folder_of(1, dcim.handle);
        store
    }

    /// Files the card still takes.
    pub(crate) fn room(&self) -> u32 {
        let files = self.on_card().filter(|object| object.format != format::FOLDER).count();
        self.capacity.saturating_sub(count(files))
    }

    pub(crate) fn capacity(&self) -> u32 {
        self.capacity
    }

    pub(crate) fn get(&self, handle: u32) -> Option<&Object> {
        self.objects.iter().find(|object| object.handle == handle)
    }

    /// The bytes of the newest file.
    pub(crate) fn newest(&self) -> Option<Vec<u8>> {
        self.objects.iter().rev().find(|object| object.format != format::FOLDER).map(|object| object.bytes.clone())
    }

    /// Handles on the card of one format (0 any) in one folder (0 any, [`ALL`] the root).
    pub(crate) fn handles(&self, wanted: u32, folder: u32) -> Vec<u32> {
        let parent = if folder == ALL { 0 } else { folder };
        self.on_card()
            .filter(|object| folder == 0 || object.parent == parent)
            .filter(|object| wanted == 0 || u32::from(object.format) == wanted)
            .map(|object| object.handle)
            .collect()
    }

    /// Writes the picture of exposure `frame` on the card. Returns what is new: a folder if one had to be made, and the file.
    pub(crate) fn put_on_card(&mut self, frame: u32, picture: Picture) -> Vec<Object> {
        let (folder, made) = self.folder_of(frame, DCIM);
        let file = self.file(CARD, folder, frame, picture);
        made.into_iter().chain([file]).collect()
    }

    /// Keeps the picture in memory until the host has it.
    pub(crate) fn put_in_memory(&mut self, frame: u32, picture: Picture) -> Object {
        self.file(0, 0, frame, picture)
    }

    /// Removes a file; false if there is none of this handle.
    pub(crate) fn remove(&mut self, handle: u32) -> bool {
        let before = self.objects.len();
        self.objects.retain(|object| object.handle != handle || object.format == format::FOLDER);
        self.objects.len() < before
    }

    fn on_card(&self) -> impl Iterator<Item = &Object> {
        self.objects.iter().filter(|object| object.storage == CARD)
    }

    /// The folder for a frame's files, and that folder if it is new.
    fn folder_of(&mut self, frame: u32, dcim: u32) -> (u32, Option<Object>) {
        let name = format!("{}EOS5D", 100 + frame.saturating_sub(1) / FILES_A_FOLDER);
        match self.objects.iter().find(|object| object.name == name) {
            Some(folder) => (folder.handle, None),
            None => {
                let folder = self.add(CARD, dcim, name, format::FOLDER, Vec::new());
                (folder.handle, Some(folder))
            }
        }
    }

    fn file(&mut self, storage: u32, parent: u32, frame: u32, picture: Picture) -> Object {
        let (extension, format) = match picture.kind {
            PictureKind::Jpeg => ("JPG", format::JPEG),
            PictureKind::Raw => ("CR2", format::CR2),
        };
        let number = frame.saturating_sub(1) % FILES_A_FOLDER + 1;
        self.add(storage, parent, format!("IMG_{number:04}.{extension}"), format, picture.bytes)
    }

    fn add(&mut self, storage: u32, parent: u32, name: String, format: u16, bytes: Vec<u8>) -> Object {
        let object = Object { handle: self.next_handle, storage, parent, name, format, bytes };
        self.next_handle += 1;
        self.objects.push(object.clone());
        object
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn picture(byte: u8) -> Picture {
        Picture { bytes: vec![byte; 3], kind: PictureKind::Jpeg }
    }

    #[test]
    fn files_are_found_in_their_folder_and_only_there() {
        let mut store = Store::new(10);
        let folder = store.handles(0, DCIM)[0];
        assert_eq!(store.handles(0, ALL), [DCIM]);
        let file = store.put_on_card(1, picture(7)).pop().unwrap();
        assert_eq!((file.name.as_str(), file.parent), ("IMG_0001.JPG", folder));
        store.put_in_memory(2, picture(8));
        assert_eq!(store.handles(0, folder), [file.handle]);
        assert_eq!(store.handles(u32::from(format::JPEG), 0), [file.handle]);
        assert_eq!(store.room(), 9);
        assert_eq!(store.newest(), Some(vec![8; 3]));
    }

    #[test]
    fn the_ten_thousandth_frame_opens_a_folder() {
        let mut store = Store::new(10);
        assert_eq!(store.put_on_card(9999, picture(1)).len(), 1);
        let new = store.put_on_card(10_000, picture(2));
        assert_eq!(new[0].name, "101EOS5D");
        assert_eq!((new[1].name.as_str(), new[1].parent), ("IMG_0001.JPG", new[0].handle));
    }

    #[test]
    fn folders_are_not_removed() {
        let mut store = Store::new(1);
        let file = store.put_on_card(1, picture(1)).pop().unwrap();
        assert_eq!(store.room(), 0);
        assert!(!store.remove(DCIM) && !store.remove(5) && store.remove(file.handle));
        assert_eq!(store.room(), 1);
    }
}
