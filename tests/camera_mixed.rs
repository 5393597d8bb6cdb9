//! Photographs that are not of one camera: mirrored, zoomed, by another body, or half a file.
#![allow(clippy::unwrap_used, clippy::panic)]

mod board_camera;

use board_camera::*;
use rigd::numerics::image::Image;
use rigd::pipeline::calibration::camera::{Board, CameraCalibration};
use rigd::pipeline::decode::decode;

/// What is done to a picture.
type Change<'a> = &'a dyn Fn(&Image<[u8; 3]>) -> Image<[u8; 3]>;

/// The picture with every pixel taken from `source`.
fn changed(picture: &Image<[u8; 3]>, source: impl Fn(f64, f64) -> (f64, f64)) -> Image<[u8; 3]> {
    let (width, height) = (picture.width, picture.height);
    let level = |x: f64, y: f64, c: usize| {
        let (x, y) = (x.clamp(0.0, width as f64 - 1.001), y.clamp(0.0, height as f64 - 1.001));
        let (left, top) = (x as usize, y as usize);
        let at = |dx: usize, dy: usize| f64::from(picture.at(left + dx, top + dy)[c]);
        let (fx, fy) = (x - left as f64, y - top as f64);
        (at(0, 0) * (1.0 - fx) + at(1, 0) * fx) * (1.0 - fy) + (at(0, 1) * (1.0 - fx) + at(1, 1) * fx) * fy
    };
    let pixel = |p: usize| {
        let (x, y) = source((p % width) as f64, (p / width) as f64);
        std::array::from_fn(|c| level(x, y, c).round() as u8)
    };
    Image { width, height, pixels: (0..width * height).map(pixel).collect() }
}

fn mirrored(picture: &Image<[u8; 3]>) -> Image<[u8; 3]> {
    changed(picture, |x, y| (picture.width as f64 - 1.0 - x, y))
}

/// As through a lens of a shorter focal length.
fn zoomed(picture: &Image<[u8; 3]>, by: f64) -> Image<[u8; 3]> {
    let about = |v: f64, size: usize| (v - size as f64 / 2.0) / by + size as f64 / 2.0;
    changed(picture, |x, y| (about(x, picture.width), about(y, picture.height)))
}

/// Names of photographs left out, with the reasons.
fn left_out(found: &CameraCalibration) -> Vec<(&str, &str)> {
    found.views.iter().filter_map(|view| Some((view.name.as_str(), view.rejected.as_deref()?))).collect()
}

#[test]
fn photographs_of_another_camera_are_named() {
    // The principal point 19 px beside the middle: mirrored, 19 px on its other side.
    let aside = |picture: Image<[u8; 3]>| changed(&picture, |x, y| (x + 25.0, y));
    let views: Vec<_> = places(12).iter().enumerate().map(|(i, place)| aside(render(place, CLEAR, i as u64))).collect();
    let with = |count: usize, change: Change<'_>| -> Vec<(String, Vec<u8>)> {
        let named = |(i, view): (usize, &Image<[u8; 3]>)| match i < count {
            true => (format!("other{i:02}.png"), png(&change(view))),
            false => (format!("view{i:02}.png"), png(view)),
        };
        views.iter().enumerate().map(named).collect()
    };
    assert_eq!(left_out(&calibrated(&with(0, &mirrored), &BOARD).unwrap()), []);
    let changes: [Change<'_>; 2] = [&mirrored, &|view| zoomed(view, 0.93)];
    for change in changes {
        let found = calibrated(&with(3, change), &BOARD).unwrap();
        let out = left_out(&found);
        assert_eq!(
            out.iter().map(|(name, _)| *name).collect::<Vec<_>>(),
            ["other00.png", "other01.png", "other02.png"]
        );
        assert!(out.iter().all(|(_, reason)| reason.contains("another camera, zoom or focus, or mirrored")), "{out:?}");
        assert!((found.focal_px[0] / 900.0 - 1.0).abs() < 0.01, "{:?}", found.focal_px);
        let error = calibrated(&with(6, change), &BOARD).unwrap_err().to_string();
        let named = (0..12).filter(|i| error.contains(&format!("{i:02}.png"))).collect::<Vec<_>>();
        let sides = [(0..6).collect::<Vec<_>>(), (6..12).collect()];
        assert!(error.contains("not of one camera") && sides.contains(&named), "{error}");
    }
}

#[test]
fn real_photographs_of_two_cameras_or_mirrored_are_named() {
    let Some(folder) = photographs() else { return };
    let board = Board { square_mm: 25.0, ..BOARD };
    let [left, right] = ["left", "right"].map(|name| side(&folder, name));
    let error = calibrated(&[left.clone(), right].concat(), &board).unwrap_err().to_string();
    let count = |name: &str| (1..15).filter(|i| error.contains(&format!("{name}{i:02}.jpg"))).count();
    assert!(
        error.contains("not of one camera") && [(13, 0), (0, 13)].contains(&(count("left"), count("right"))),
        "{error}"
    );
    let mut some = left;
    for (name, bytes) in &mut some[10..] {
        *bytes = png(&mirrored(&decode(bytes).unwrap()));
        *name = format!("mirrored-{name}");
    }
    let found = calibrated(&some, &board).unwrap();
    let names: Vec<&str> = left_out(&found).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["mirrored-left12.jpg", "mirrored-left13.jpg", "mirrored-left14.jpg"]);
}

#[test]
fn another_model_or_focal_length_in_the_exif_is_named() {
    let jpeg = |picture: &Image<[u8; 3]>, model: &str, focal_mm: u32| {
        let mut writer = exif::experimental::Writer::new();
        let fields = [
            (exif::Tag::Model, exif::Value::Ascii(vec![model.as_bytes().to_vec()])),
            (exif::Tag::FocalLength, exif::Value::Rational(vec![exif::Rational { num: focal_mm, denom: 1 }])),
        ]
        .map(|(tag, value)| exif::Field { tag, ifd_num: exif::In::PRIMARY, value });
        fields.iter().for_each(|field| writer.push_field(field));
        let mut block = std::io::Cursor::new(Vec::new());
        writer.write(&mut block, true).unwrap();
        let mut bytes = Vec::new();
        let mut encoder = jpeg_encoder::Encoder::new(&mut bytes, 97);
        encoder.add_exif_metadata(&block.into_inner()).unwrap();
        let (width, height) = (picture.width as u16, picture.height as u16);
        encoder.encode(picture.pixels.as_flattened(), width, height, jpeg_encoder::ColorType::Rgb).unwrap();
        bytes
    };
    let shot = |(i, place): (usize, &Place)| {
        let (model, focal) = [("EOS 20D", 200), ("EOS 5D", 135), ("EOS 5D", 200)][i.min(2)];
        (format!("{i}.jpg"), jpeg(&render(place, CLEAR, i as u64), model, focal))
    };
    let mut all: Vec<_> = places(8).iter().enumerate().map(shot).collect();
    all.push(("plain.png".into(), files(9).remove(8).1));
    let found = calibrated(&all, &BOARD).unwrap();
    let out = left_out(&found);
    assert_eq!(out.iter().map(|(name, _)| *name).collect::<Vec<_>>(), ["0.jpg", "1.jpg"]);
    assert!(out[0].1.contains("its EXIF says EOS 20D, 200 mm, that of most EOS 5D, 200 mm"), "{}", out[0].1);
    assert!(out[1].1.contains("EOS 5D, 135 mm"), "{}", out[1].1);
}

#[test]
fn half_a_photograph_with_an_end_is_called_damaged() {
    let Some(folder) = photographs() else { return };
    let mut some = side(&folder, "left");
    let half = some[2].1.len() / 2;
    some[2].1.truncate(half);
    some[2].1.extend([0xff, 0xd9]);
    let found = calibrated(&some, &BOARD).unwrap();
    assert!(
        matches!(left_out(&found)[..], [("left03.jpg", reason)] if reason.contains("end early")),
        "{:?}",
        left_out(&found)
    );
}
