//! A document as PDF: A4, the fonts every reader has, an outline of the sections. No date and no random name: the same document gives the same
//! bytes.

mod font;
mod lines;
mod page;
mod shapes;

use super::{Block, Document, Drawing, Picture, Table, shown};
use font::{Font, encode};
use lines::{fit_columns, wrap};
use page::{HEIGHT, LEFT, Pages, Style, WIDTH};
use pdf_writer::{Filter, Finish as _, Name, Pdf, Rect, Ref, TextStr};

const TITLE: Style = Style { font: Font::Bold, size: 18.0, lead: 23.0 };
const SECTION: Style = Style { font: Font::Bold, size: 13.0, lead: 17.0 };
const HEADING: Style = Style { font: Font::Bold, size: 10.5, lead: 14.0 };
const BODY: Style = Style { font: Font::Plain, size: 9.5, lead: 13.0 };
const STRONG: Style = Style { font: Font::Bold, ..BODY };
const CELL: Style = Style { font: Font::Plain, size: 8.5, lead: 11.0 };
const HEAD: Style = Style { font: Font::Bold, ..CELL };
const NOTE: Style = Style { font: Font::Plain, size: 8.5, lead: 11.5 };

/// Between the columns of a table.
const GAP: f64 = 8.0;
/// Highest picture.
const TALLEST: f64 = 260.0;

/// The document as PDF.
pub fn write(document: &Document) -> Vec<u8> {
    let mut pages = Pages::new();
    pages.paragraph(&document.title, TITLE, LEFT, WIDTH);
    let mut sections = Vec::new();
    let mut pictures = Vec::new();
    for (index, block) in document.blocks.iter().enumerate() {
        match block {
            Block::Section(text) => {
                pages.ensure(together(&document.blocks[index..]));
                pages.skip(12.0);
                sections.push((text.as_str(), pages.place()));
                pages.paragraph(text, SECTION, LEFT, WIDTH);
                pages.rule();
            }
            Block::Heading(text) => {
                pages.ensure(together(&document.blocks[index..]));
                pages.skip(6.0);
                pages.paragraph(text, HEADING, LEFT, WIDTH);
            }
            Block::Paragraph(text) => pages.paragraph(text, BODY, LEFT, WIDTH),
            Block::Warning(text) => warning(&mut pages, text),
            Block::List(items) => items.iter().for_each(|item| {
                pages.ensure(BODY.lead);
                pages.mark("\u{2022}", BODY, LEFT + 4.0);
                pages.paragraph(item, BODY, LEFT + 14.0, WIDTH - 14.0);
            }),
            Block::Table(table) => put_table(&mut pages, table),
            Block::Drawing(drawing) => {
                pages.ensure(together(&document.blocks[index..=index]));
                shapes::put(&mut pages, drawing, scale_of(drawing));
                pages.paragraph(&drawing.caption, NOTE, LEFT, WIDTH);
            }
            Block::Picture(picture) => {
                pages.ensure(together(&document.blocks[index..=index]));
                put_picture(&mut pages, picture, &mut pictures);
            }
        }
    }
    finish(&document.title, pages, &sections, &pictures)
}

/// Room that headings need with what they head, and a block by itself so that it is not parted where it must not be.
fn together(blocks: &[Block]) -> f64 {
    match blocks.first() {
        Some(Block::Section(_)) => 40.0 + together(&blocks[1..]),
        Some(Block::Heading(_)) => 24.0 + together(&blocks[1..]),
        Some(Block::Drawing(drawing)) => height_of(drawing) + 30.0,
        Some(Block::Picture(picture)) => {
            let scale = picture.scale.as_ref().map_or(0.0, |scale| height_of(scale) + 8.0);
            size_of(picture)[1] + scale + 36.0
        }
        Some(Block::Table(_)) => 60.0,
        Some(_) => 40.0,
        None => 0.0,
    }
}

fn scale_of(drawing: &Drawing) -> f64 {
    (WIDTH / drawing.size[0]).min(1.0)
}

fn height_of(drawing: &Drawing) -> f64 {
    scale_of(drawing) * drawing.size[1]
}

/// Width and height of a picture on the page.
fn size_of(picture: &Picture) -> [f64; 2] {
    let [width, height] = picture.size.map(|side| f64::from(side.max(1)));
    let scale = (WIDTH / width).min(TALLEST / height).min(1.0);
    [scale * width, scale * height]
}

fn warning(pages: &mut Pages, text: &str) {
    pages.ensure(2.0 * BODY.lead);
    pages.mark("!", STRONG, LEFT);
    pages.paragraph(&format!("Warning: {text}"), STRONG, LEFT + 12.0, WIDTH - 12.0);
}

fn put_table(pages: &mut Pages, table: &Table) {
    pages.ensure(60.0);
    pages.paragraph(&table.caption, HEAD, LEFT, WIDTH);
    let columns: Vec<Vec<u8>> = table.columns.iter().map(|text| encode(&shown(text))).collect();
    let rows: Vec<Vec<Vec<u8>>> =
        table.rows.iter().map(|row| row.iter().map(|text| encode(&shown(text))).collect()).collect();
    let natural = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column)).map(|text| CELL.font.width(text, CELL.size));
        cells.fold(HEAD.font.width(&columns[column], HEAD.size), f64::max) + GAP
    };
    let widths = fit_columns(&(0..columns.len()).map(natural).collect::<Vec<_>>(), WIDTH);
    put_row(pages, &columns, &widths, HEAD);
    for row in &rows {
        let before = pages.number();
        let height = row_height(row, &widths);
        pages.ensure(height.min(0.5 * HEIGHT));
        if pages.number() > before {
            put_row(pages, &columns, &widths, HEAD);
        }
        put_row(pages, row, &widths, CELL);
    }
    pages.skip(6.0);
}

fn row_height(row: &[Vec<u8>], widths: &[f64]) -> f64 {
    let lines = row.iter().zip(widths).map(|(text, width)| wrap(text, CELL, width - GAP).len());
    lines.max().unwrap_or(0) as f64 * CELL.lead
}

/// One row, line by line: one that is longer than a page goes on on the next.
fn put_row(pages: &mut Pages, row: &[Vec<u8>], widths: &[f64], style: Style) {
    let cells: Vec<Vec<&[u8]>> = row.iter().zip(widths).map(|(text, width)| wrap(text, style, width - GAP)).collect();
    let lines = cells.iter().map(Vec::len).max().unwrap_or(0);
    for line in 0..lines {
        pages.ensure(style.lead);
        let mut x = LEFT;
        for (cell, width) in cells.iter().zip(widths) {
            if let Some(text) = cell.get(line) {
                pages.show(text, style, x);
            }
            x += width;
        }
        pages.skip(style.lead);
    }
    pages.rule();
}

/// What a PNG file holds of pixels is what a PDF can hold as well: compressed rows with PNG's predictors.
fn put_picture<'a>(pages: &mut Pages, picture: &'a Picture, pictures: &mut Vec<&'a Picture>) {
    if picture.size.contains(&0) {
        return pages.paragraph(&picture.alternative, NOTE, LEFT, WIDTH);
    }
    pages.picture(pictures.len(), size_of(picture));
    pictures.push(picture);
    let mut caption = picture.caption.clone();
    if let Some(scale) = &picture.scale {
        pages.skip(4.0);
        shapes::put(pages, scale, scale_of(scale));
        caption = format!("{} {caption}", scale.caption);
    }
    pages.paragraph(&caption, NOTE, LEFT, WIDTH);
}

/// Compressed pixels of a PNG file: the bodies of its IDAT chunks.
fn compressed(png: &[u8]) -> Vec<u8> {
    let (mut out, mut rest) = (Vec::new(), png.get(8..).unwrap_or_default());
    while let Some((head, body)) = rest.split_first_chunk::<8>() {
        let length = u32::from_be_bytes([head[0], head[1], head[2], head[3]]) as usize;
        let Some(data) = body.get(..length) else { break };
        if &head[4..] == b"IDAT" {
            out.extend_from_slice(data);
        }
        // A checksum of four bytes follows.
        rest = body.get(length + 4..).unwrap_or_default();
    }
    out
}

/// Numbers of the objects of a file, one after the other.
struct Numbers(i32);

impl Numbers {
    fn next(&mut self) -> Ref {
        self.0 += 1;
        Ref::new(self.0)
    }
}

fn finish(title: &str, pages: Pages, sections: &[(&str, (usize, f64))], pictures: &[&Picture]) -> Vec<u8> {
    let mut numbers = Numbers(0);
    let (catalog, tree, info, outline) = (numbers.next(), numbers.next(), numbers.next(), numbers.next());
    let fonts = Font::ALL.map(|font| (font, numbers.next()));
    let images: Vec<Ref> = pictures.iter().map(|_| numbers.next()).collect();
    let items: Vec<Ref> = sections.iter().map(|_| numbers.next()).collect();
    let contents = pages.finish();
    let leaves: Vec<(Ref, Ref)> = contents.iter().map(|_| (numbers.next(), numbers.next())).collect();
    let mut pdf = Pdf::new();
    let mut root = pdf.catalog(catalog);
    root.pages(tree).outlines(outline).lang(TextStr("en"));
    root.viewer_preferences().display_doc_title(true);
    root.finish();
    pdf.document_info(info).title(TextStr(&shown(title))).producer(TextStr(crate::document::pdf::PRODUCER));
    let count = i32::try_from(leaves.len()).unwrap_or(i32::MAX);
    pdf.pages(tree).kids(leaves.iter().map(|(page, _)| *page)).count(count);
    for ((page, content), bytes) in leaves.iter().zip(&contents) {
        let mut leaf = pdf.page(*page);
        leaf.parent(tree).media_box(Rect::new(0.0, 0.0, page::PAPER[0], page::PAPER[1])).contents(*content);
        let mut resources = leaf.resources();
        let mut known = resources.fonts();
        for (font, id) in fonts {
            known.pair(font.key(), id);
        }
        known.finish();
        let mut known = resources.x_objects();
        for (index, id) in images.iter().enumerate() {
            known.pair(Name(page::picture_name(index).as_bytes()), *id);
        }
        known.finish();
        resources.finish();
        leaf.finish();
        pdf.stream(*content, bytes);
    }
    for (font, id) in fonts {
        pdf.type1_font(id).base_font(font.name()).encoding_predefined(Name(b"WinAnsiEncoding"));
    }
    for (picture, id) in pictures.iter().zip(&images) {
        let data = compressed(&picture.png);
        let [width, height] = picture.size.map(|side| i32::try_from(side).unwrap_or(i32::MAX));
        let mut image = pdf.image_xobject(*id, &data);
        image.width(width).height(height).bits_per_component(8).filter(Filter::FlateDecode);
        image.color_space().device_rgb();
        image
            .decode_parms()
            .predictor(pdf_writer::types::Predictor::PngOptimum)
            .colors(3)
            .bits_per_component(8)
            .columns(width);
    }
    put_outline(&mut pdf, outline, &items, sections, &leaves);
    pdf.finish()
}

fn put_outline(pdf: &mut Pdf, outline: Ref, items: &[Ref], sections: &[(&str, (usize, f64))], leaves: &[(Ref, Ref)]) {
    let mut root = pdf.outline(outline);
    if let (Some(first), Some(last)) = (items.first(), items.last()) {
        root.first(*first).last(*last).count(i32::try_from(items.len()).unwrap_or(i32::MAX));
    }
    root.finish();
    for (i, (text, (page, top))) in sections.iter().enumerate() {
        let mut item = pdf.outline_item(items[i]);
        item.parent(outline).title(TextStr(&shown(text)));
        if i > 0 {
            item.prev(items[i - 1]);
        }
        if let Some(next) = items.get(i + 1) {
            item.next(*next);
        }
        if let Some((leaf, _)) = leaves.get(*page) {
            item.dest().page(*leaf).xyz(0.0, *top as f32, None);
        }
    }
}

/// The program that writes.
const PRODUCER: &str = concat!("rigd ", env!("CARGO_PKG_VERSION"));
