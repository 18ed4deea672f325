// SPDX-License-Identifier: Apache-2.0
#include "commands.hpp"

#include <array>

namespace plumbline::apps {
namespace {

constexpr std::array kCommands{
    Command{"target", "describe a board (new) and draw it at true scale (print)", add_target},
    Command{"detect", "find a board's corners in images", add_detect},
    Command{"calibrate", "images or corners of a board -> lenses, poses and rig", add_calibrate},
    Command{"crosscheck", "mrcal as referee on the same corners", add_crosscheck},
    Command{"rectify", "stereo images -> rows that match", add_rectify},
    Command{"undistort", "images of one camera -> images of a pinhole camera", add_undistort},
    Command{"convert", "camera files from and to other software's formats", add_convert},
    Command{"compare", "projection difference of two calibrations over the image", add_compare},
    Command{"simulate", "images and corners of a board with known truth", add_simulate},
    Command{"geometry", "poses, points and the relations of views, from lists of points", add_geometry},
    Command{"list", "lenses, formats, targets, commands and verbs that there are", add_list},
};

}  // namespace

std::span<const Command> commands() { return kCommands; }

}  // namespace plumbline::apps
