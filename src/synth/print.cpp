// SPDX-License-Identifier: Apache-2.0
#include "plumbline/synth/print.hpp"

#include <cairo-pdf.h>
#include <cairo-svg.h>
#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <numbers>

#include "page.hpp"
#include "plumbline/synth/board.hpp"
#include "png.hpp"
#include "stroke_font.hpp"

namespace plumbline {
namespace {

using Surface = std::unique_ptr<cairo_surface_t, void (*)(cairo_surface_t*)>;
using Context = std::unique_ptr<cairo_t, void (*)(cairo_t*)>;

constexpr double kPtPerMm = 72 / 25.4;
constexpr int kMaxSidePx = 30000;  // cairo's own limit is 32767

cairo_status_t append(void* bytes, const unsigned char* data, unsigned int length) {
  static_cast<std::string*>(bytes)->append(reinterpret_cast<const char*>(data), length);
  return CAIRO_STATUS_SUCCESS;
}

// All shapes are ONE path: viewers that smooth edges would show a fine white seam between two shapes that
// touch.
void draw_shapes(cairo_t* cr, const BoardDrawing& board, const Vec2& page_mm) {
  const Vec2 centre = 0.5 * (board.low + board.high);
  const double up = board.y_up ? -1 : 1;
  const auto to_mm = [&](const Vec2& p) -> Vec2 {
    return 0.5 * page_mm + 1e3 * Vec2(p.x() - centre.x(), up * (p.y() - centre.y()));
  };
  cairo_new_path(cr);
  for (const Box& box : board.boxes) {
    // Absolute corners, so that boxes that touch share one rounded edge.
    const Vec2 a = to_mm(box.low), b = to_mm(box.high);
    cairo_move_to(cr, a.x(), a.y());
    cairo_line_to(cr, b.x(), a.y());
    cairo_line_to(cr, b.x(), b.y());
    cairo_line_to(cr, a.x(), b.y());
    cairo_close_path(cr);
  }
  for (const Disc& disc : board.discs) {
    const Vec2 c = to_mm(disc.centre);
    cairo_new_sub_path(cr);
    cairo_arc(cr, c.x(), c.y(), 1e3 * disc.radius, 0, 2 * std::numbers::pi);
    cairo_close_path(cr);
  }
  cairo_fill(cr);
}

// Name and ruler in the lower border, when it is at least 12 mm high and the ruler fits.
void draw_legend(cairo_t* cr, const BoardDrawing& board, const Vec2& page_mm) {
  const double border = 0.5 * (page_mm.y() - 1e3 * board.size().y());
  if (border < 12 || page_mm.x() < 115) return;
  const double foot = page_mm.y() - detail::kPageBorderMm, left = 0.5 * page_mm.x() - 50;
  cairo_set_line_width(cr, 0.2);
  cairo_set_line_cap(cr, CAIRO_LINE_CAP_BUTT);
  cairo_move_to(cr, left, foot);
  cairo_line_to(cr, left + 100, foot);
  for (int mm = 0; mm <= 100; mm += 10) {
    cairo_move_to(cr, left + mm, foot + 0.1);
    cairo_line_to(cr, left + mm, foot - (mm % 50 == 0 ? 2.0 : 1.2));
  }
  cairo_stroke(cr);
  // The loops of letters are circles too for a finder of circle grids; those boards carry the ruler only.
  if (!board.discs.empty()) return;

  const std::string text = fmt::format("{}: {}; this ruler: 100 mm", board.name, board.note);
  const double height =
      std::min(1.8, 1.8 * (page_mm.x() - 2 * detail::kPageBorderMm) / detail::text_width(text, 1.8));
  const Vec2 start(0.5 * (page_mm.x() - detail::text_width(text, height)), foot - 3.4);
  for (const auto& stroke : detail::text_strokes(text, height)) {
    cairo_move_to(cr, start.x() + stroke[0].x(), start.y() + stroke[0].y());
    for (std::size_t i = 1; i < stroke.size(); ++i)
      cairo_line_to(cr, start.x() + stroke[i].x(), start.y() + stroke[i].y());
  }
  cairo_stroke(cr);
}

// Where to cut the parts of a rig: short lines outside the corners of the sheet.
void draw_crop_marks(cairo_t* cr, const BoardDrawing& board, const Vec2& page_mm) {
  const Vec2 half = 0.5e3 * (board.sheet_high() - board.sheet_low());
  cairo_set_line_width(cr, 0.15);
  for (const double sx : {-1.0, 1.0}) {
    for (const double sy : {-1.0, 1.0}) {
      const Vec2 corner = 0.5 * page_mm + Vec2(sx * half.x(), sy * half.y());
      cairo_move_to(cr, corner.x() + sx, corner.y());
      cairo_line_to(cr, corner.x() + 5 * sx, corner.y());
      cairo_move_to(cr, corner.x(), corner.y() + sy);
      cairo_line_to(cr, corner.x(), corner.y() + 5 * sy);
    }
  }
  cairo_stroke(cr);
}

void draw_page(cairo_t* cr, const BoardDrawing& board, const Vec2& page_mm, bool is_part) {
  draw_shapes(cr, board, page_mm);
  if (is_part) draw_crop_marks(cr, board, page_mm);
  draw_legend(cr, board, page_mm);
}

void draw_side_by_side(cairo_t* cr, const std::vector<BoardDrawing>& boards, const Vec2& page_mm,
                       cairo_operator_t ink) {
  cairo_set_source_rgb(cr, 1, 1, 1);
  cairo_paint(cr);
  cairo_set_source_rgb(cr, 0, 0, 0);
  cairo_set_operator(cr, ink);
  for (const BoardDrawing& board : boards) {
    draw_page(cr, board, page_mm, boards.size() > 1);
    cairo_translate(cr, page_mm.x(), 0);
  }
}

Error cairo_failed(cairo_status_t status) {
  return {ErrorCode::kInvalidData, fmt::format("drawing failed: {}", cairo_status_to_string(status)),
          "print"};
}

// Closes the surface, so that `bytes` is complete.
Status finish(Context& cr, Surface& surface) {
  const cairo_status_t drawn = cairo_status(cr.get());
  cr.reset();
  cairo_surface_finish(surface.get());
  const cairo_status_t written = cairo_surface_status(surface.get());
  if (drawn != CAIRO_STATUS_SUCCESS) return cairo_failed(drawn);
  if (written != CAIRO_STATUS_SUCCESS) return cairo_failed(written);
  return {};
}

Result<std::string> pdf(const std::vector<BoardDrawing>& boards, const Vec2& page_mm,
                        const std::string& title) {
  std::string bytes;
  const Vec2 page_pt = kPtPerMm * page_mm;
  Surface surface(cairo_pdf_surface_create_for_stream(append, &bytes, page_pt.x(), page_pt.y()),
                  cairo_surface_destroy);
  // A fixed date: cairo writes the time of day otherwise, and the same board would give other bytes.
  cairo_pdf_surface_set_metadata(surface.get(), CAIRO_PDF_METADATA_CREATE_DATE, "2000-01-01T00:00:00Z");
  cairo_pdf_surface_set_metadata(surface.get(), CAIRO_PDF_METADATA_TITLE, title.c_str());
  Context cr(cairo_create(surface.get()), cairo_destroy);
  cairo_scale(cr.get(), kPtPerMm, kPtPerMm);
  for (const BoardDrawing& board : boards) {
    draw_page(cr.get(), board, page_mm, boards.size() > 1);
    cairo_show_page(cr.get());
  }
  if (Status done = finish(cr, surface); !done) return done.error();
  return bytes;
}

Result<std::string> svg(const std::vector<BoardDrawing>& boards, const Vec2& page_mm) {
  std::string bytes;
  const Vec2 page_pt = kPtPerMm * Vec2(page_mm.x() * static_cast<double>(boards.size()), page_mm.y());
  Surface surface(cairo_svg_surface_create_for_stream(append, &bytes, page_pt.x(), page_pt.y()),
                  cairo_surface_destroy);
  cairo_svg_surface_set_document_unit(surface.get(), CAIRO_SVG_UNIT_PT);
  Context cr(cairo_create(surface.get()), cairo_destroy);
  cairo_scale(cr.get(), kPtPerMm, kPtPerMm);
  draw_side_by_side(cr.get(), boards, page_mm, CAIRO_OPERATOR_OVER);
  if (Status done = finish(cr, surface); !done) return done.error();
  // cairo numbers its surfaces through the life of the process; the number means nothing in the file.
  for (std::size_t at = 0; (at = bytes.find("id=\"surface", at)) != std::string::npos; at += 10) {
    const std::size_t end = bytes.find('"', at + 4);
    bytes.replace(at, end - at, "id=\"board");
  }
  return bytes;
}

Result<std::string> png(const std::vector<BoardDrawing>& boards, const Vec2& page_mm, int dpi) {
  const double px_per_mm = dpi / 25.4;
  const double width = std::round(px_per_mm * page_mm.x()) * static_cast<double>(boards.size());
  const double height = std::round(px_per_mm * page_mm.y());
  if (dpi < 10 || width > kMaxSidePx || height > kMaxSidePx) {
    return Error{
        ErrorCode::kUnsupported,
        fmt::format(
            "a PNG of {:.0f}x{:.0f} px ({} dpi) cannot be drawn (10 dpi to {} px a side); print .pdf or .svg",
            width, height, dpi, kMaxSidePx),
        "print"};
  }
  // An alpha-only surface is written as a grey PNG: opaque is white, and the shapes take the opacity away.
  Surface surface(
      cairo_image_surface_create(CAIRO_FORMAT_A8, static_cast<int>(width), static_cast<int>(height)),
      cairo_surface_destroy);
  Context cr(cairo_create(surface.get()), cairo_destroy);
  cairo_set_antialias(cr.get(), CAIRO_ANTIALIAS_BEST);
  cairo_scale(cr.get(), px_per_mm, px_per_mm);
  draw_side_by_side(cr.get(), boards, page_mm, CAIRO_OPERATOR_DEST_OUT);
  if (const auto status = cairo_status(cr.get()); status != CAIRO_STATUS_SUCCESS) return cairo_failed(status);
  std::string bytes;
  if (const auto status = cairo_surface_write_to_png_stream(surface.get(), append, &bytes);
      status != CAIRO_STATUS_SUCCESS) {
    return cairo_failed(status);
  }
  return detail::png_with_dpi(bytes, dpi);
}

}  // namespace

Result<PrintFormat> print_format_of(std::string_view file_name) {
  if (file_name.ends_with(".pdf")) return PrintFormat::kPdf;
  if (file_name.ends_with(".svg")) return PrintFormat::kSvg;
  if (file_name.ends_with(".png")) return PrintFormat::kPng;
  return Error{ErrorCode::kUnsupported, "a board is printed as .pdf, .svg or .png", std::string(file_name)};
}

Result<Print> print_target(const Target& target, const PrintOptions& options) {
  const auto boards = draw_target(target);
  if (!boards) return boards.error();
  Vec2 needed_mm = Vec2::Zero();
  for (const BoardDrawing& board : *boards) {
    // The parts of a rig are cut out, so their whole sheet must be on the page.
    const Vec2 size = boards->size() > 1 ? Vec2(board.sheet_high() - board.sheet_low()) : board.size();
    needed_mm = needed_mm.cwiseMax(1e3 * size);
  }
  const auto page = detail::choose_page(options.page, needed_mm);
  if (!page) return page.error();
  auto bytes = options.format == PrintFormat::kPdf   ? pdf(*boards, page->size_mm, target.name)
               : options.format == PrintFormat::kSvg ? svg(*boards, page->size_mm)
                                                     : png(*boards, page->size_mm, options.dpi);
  if (!bytes) return bytes.error();
  return Print{*std::move(bytes), page->name, page->size_mm, static_cast<int>(boards->size())};
}

}  // namespace plumbline
