// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <string_view>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"
#include "plumbline/target/target.hpp"

namespace plumbline {

enum class PrintFormat { kPdf, kSvg, kPng };

/// From a file's name ("board.pdf"); kUnsupported for anything but .pdf, .svg and .png.
Result<PrintFormat> print_format_of(std::string_view file_name);

struct PrintOptions {
  PrintFormat format = PrintFormat::kPdf;
  std::string page =
      "auto";     ///< A4 A3 A2 A1 A0 letter WxHmm, or auto: the smallest of A4..A0 that the board fits
  int dpi = 300;  ///< of a PNG
};

/// What was printed.
struct Print {
  std::string bytes;  ///< the file
  std::string page;   ///< "A4", "A4 landscape", "300x500mm"
  Vec2 page_mm;       ///< width and height of one page, after turning
  int n_pages = 1;
};

/// The board at true scale on a page, centred, the page turned to landscape when the board fits only so, with
/// a white border of at least 5 mm. Where the lower border has room: the name, the true sizes and a ruler of
/// 100 mm to check the paper with. PDF and SVG coordinates are good to 1/256 pt (1.4 um), PNG edges are grey
/// levels of exact areas and the file carries its dpi. A rig of boards is one page per part; SVG and PNG,
/// which have no pages, put them side by side. The same target gives the same bytes: no dates, no fonts of
/// the machine. kInvalidData: the board does not fit the page (says the size needed and the next page that
/// fits), or an unknown page; kUnsupported: free points, or a PNG of more than 30,000 px a side.
Result<Print> print_target(const Target& target, const PrintOptions& options = {});

}  // namespace plumbline
