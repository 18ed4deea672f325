// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "image/imageio_api.hpp"
#include "plumbline/core/result.hpp"

namespace plumbline::detail {

/// The image codecs, loaded on the first call (thread-safe). kIo says where the module was looked for.
Result<const ImageioApi*> image_codec();

/// The same for videos.
Result<const VideoioApi*> video_codec();

}  // namespace plumbline::detail
