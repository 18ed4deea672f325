// SPDX-License-Identifier: Apache-2.0
#include <csignal>
#include <cstdio>
#include <cstdlib>

#include <glog/logging.h>

#include "program.hpp"

int main(int argc, char** argv) {
  // A file that grows past the user's limit is then an error of write(), with a message, instead of a death.
  std::signal(SIGXFSZ, SIG_IGN);
  // What FFmpeg finds wrong with a video is in our own message; who wants its words sets this variable.
  setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);
  // Ceres logs through glog: only what is fatal, and never to files.
  FLAGS_logtostderr = true;
  FLAGS_minloglevel = google::GLOG_FATAL;
  google::InitGoogleLogging(argv[0]);
  return plumbline::apps::run_program(argc, argv);
}
