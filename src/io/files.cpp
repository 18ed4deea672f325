// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/files.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <system_error>
#include <utility>

#include "io/own_files.hpp"
#include "plumbline/core/check.hpp"

namespace plumbline {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kMaxFileBytes = std::size_t{256} << 20;

std::string reason(int error) { return std::generic_category().message(error); }

Error io_error(const fs::path& file, const std::string& what) {
  return {ErrorCode::kIo, what, file.string()};
}

/// A file descriptor that closes itself.
class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() { close(); }
  int get() const { return fd_; }
  bool ok() const { return fd_ >= 0; }
  /// 0 or the error; network file systems report a full disc only here.
  int close() {
    const int fd = std::exchange(fd_, -1);
    return fd >= 0 && ::close(fd) != 0 && errno != EINTR ? errno : 0;
  }

 private:
  int fd_;
};

/// 0 or the error number.
int write_all(int fd, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t n = ::write(fd, bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return errno;
    bytes.remove_prefix(static_cast<std::size_t>(n));
  }
  return 0;
}

/// Calls make(path) with names beside `final` until one is free; the name is short, so that it fits wherever
/// the final one does, and hidden. make returns false with errno set.
template <class Make>
std::optional<fs::path> unique_sibling(const fs::path& final, Make&& make) {
  for (int n = 0; n < 10000; ++n) {
    fs::path candidate = final.parent_path() / fmt::format(".plumbline-{}-{}", ::getpid(), n);
    if (make(candidate)) return candidate;
    if (errno != EEXIST) return std::nullopt;
  }
  return std::nullopt;
}

/// rename() that fails with EEXIST where `to` exists. Not every file system knows the flag: those are asked
/// first.
int rename_to_new(const fs::path& from, const fs::path& to) {
  if (::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE) == 0) return 0;
  if (errno != EINVAL && errno != ENOSYS) return errno;
  std::error_code ignored;
  if (fs::exists(fs::symlink_status(to, ignored))) return EEXIST;
  return ::rename(from.c_str(), to.c_str()) == 0 ? 0 : errno;
}

const char* const kExists = "exists already; give another name, or --force to replace it";

/// Where a path leads when it is a symbolic link, also a dangling one.
fs::path resolved(const fs::path& path) {
  std::error_code error;
  if (!fs::is_symlink(fs::symlink_status(path, error))) return path;
  fs::path target = fs::weakly_canonical(path, error);
  return error ? path : target;
}

Status write_into(const fs::path& device, std::string_view bytes) {
  Descriptor fd(::open(device.c_str(), O_WRONLY | O_CLOEXEC));
  if (!fd.ok()) return io_error(device, "cannot be opened for writing: " + reason(errno));
  int error = write_all(fd.get(), bytes);
  if (const int at_close = fd.close(); error == 0) error = at_close;
  if (error != 0) return io_error(device, "cannot be written: " + reason(error));
  return {};
}

}  // namespace

Result<std::string> read_file(const fs::path& file) {
  Descriptor fd(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  if (!fd.ok()) return io_error(file, "cannot be read: " + reason(errno));
  struct stat status {};
  if (::fstat(fd.get(), &status) != 0) return io_error(file, "cannot be read: " + reason(errno));
  if (S_ISDIR(status.st_mode)) return io_error(file, "is a directory where a file is needed");
  std::string bytes;
  if (S_ISREG(status.st_mode)) bytes.reserve(std::min<std::size_t>(status.st_size, kMaxFileBytes));
  std::string chunk(std::size_t{1} << 16, '\0');
  for (;;) {
    const ssize_t n = ::read(fd.get(), chunk.data(), chunk.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return io_error(file, "cannot be read: " + reason(errno));
    if (n == 0) return bytes;
    bytes.append(chunk, 0, static_cast<std::size_t>(n));
    if (bytes.size() > kMaxFileBytes)
      return io_error(file, "is larger than 256 MiB, which no file of this kind is");
  }
}

Status write_file(const fs::path& path, std::string_view bytes, bool force) {
  if (path.filename().empty()) return io_error(path, "is not the name of a file");
  const fs::path file = resolved(path);
  std::error_code ignored;
  const fs::file_status old = fs::status(file, ignored);
  if (fs::is_directory(old)) return io_error(path, "is a directory; give the name of a file");
  if (fs::exists(old) && !fs::is_regular_file(old)) return write_into(file, bytes);
  if (fs::exists(old) && !force) return io_error(path, kExists);

  int raw = -1;
  const auto temporary = unique_sibling(file, [&](const fs::path& name) {
    raw = ::open(name.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    return raw >= 0;
  });
  if (!temporary) return io_error(path, "cannot be written: " + reason(errno));
  Descriptor fd(raw);
  int error = write_all(fd.get(), bytes);
  if (const int at_close = fd.close(); error == 0) error = at_close;
  if (error == 0 && force) error = ::rename(temporary->c_str(), file.c_str()) == 0 ? 0 : errno;
  if (error == 0 && !force) error = rename_to_new(*temporary, file);
  if (error == 0) return {};
  ::unlink(temporary->c_str());
  if (error == EEXIST) return io_error(path, kExists);
  return io_error(path, fmt::format("cannot be written ({} bytes): {}; nothing was left behind", bytes.size(),
                                    reason(error)));
}

namespace {

/// Whether `inner` is `directory` or below it.
bool holds(const fs::path& directory, const fs::path& inner) {
  std::error_code error;
  const fs::path in = fs::canonical(inner, error);
  if (error) return false;
  const fs::path outer = fs::canonical(directory, error);
  if (error) return false;
  const auto [a, b] = std::mismatch(outer.begin(), outer.end(), in.begin(), in.end());
  return a == outer.end();
}

/// Whether all of an existing directory may go: replacing it removes what is in it.
Status check_replaceable(const fs::path& directory) {
  std::error_code ignored;
  const char* const home = std::getenv("HOME");
  const char* what = nullptr;
  if (holds(directory, fs::current_path(ignored))) what = "the working directory";
  if (home && *home && holds(directory, home)) what = "your home directory";
  if (what) {
    return io_error(directory,
                    fmt::format("holds {} and will not be replaced; give the name of a new directory", what));
  }
  if (const auto foreign = io::foreign_file(directory)) {
    return io_error(directory,
                    fmt::format("holds {}, which Plumbline did not write; remove it or choose another -o",
                                foreign->string()));
  }
  return {};
}

Status check_destination(const fs::path& directory, bool force) {
  std::error_code ignored;
  const fs::file_status old = fs::status(directory, ignored);
  if (!fs::exists(old)) return {};
  if (!fs::is_directory(old)) return io_error(directory, "is a file; give the name of a directory");
  if (!force) return io_error(directory, kExists);
  return check_replaceable(directory);
}

/// Puts `fresh` in the place of the directory `old` and removes what was there. 0 or the error, and then
/// `old` is as it was.
int replace_directory(const fs::path& fresh, const fs::path& old) {
  std::error_code ignored;
  if (::renameat2(AT_FDCWD, fresh.c_str(), AT_FDCWD, old.c_str(), RENAME_EXCHANGE) == 0) {
    fs::remove_all(fresh, ignored);
    return 0;
  }
  if (errno != EINVAL && errno != ENOSYS) return errno;
  // Without an atomic exchange: aside, in, and back again where that fails.
  const auto aside = unique_sibling(old, [&](const fs::path& name) {
    const int error = rename_to_new(old, name);
    errno = error;
    return error == 0;
  });
  if (!aside) return errno;
  if (::rename(fresh.c_str(), old.c_str()) != 0) {
    const int error = errno;
    ::rename(aside->c_str(), old.c_str());
    return error;
  }
  fs::remove_all(*aside, ignored);
  return 0;
}

}  // namespace

Result<OutputDir> OutputDir::create(const fs::path& directory, bool force) {
  // "out/" and "out" are the same place, and a link to a directory stays a link.
  fs::path final = directory.has_filename() ? directory : directory.parent_path();
  if (final.empty()) return io_error(directory, "is not the name of a directory");
  if (Status fit = check_destination(final, force); !fit) return fit.error();
  final = resolved(final);
  OutputDir output;
  output.final_ = final;
  output.force_ = force;
  // The parents that are not there yet are made too, as mkdir -p does, and vanish again with a run that
  // fails.
  std::error_code error;
  for (fs::path parent = final.parent_path(); !parent.empty() && !fs::exists(parent, error);
       parent = parent.parent_path()) {
    output.made_parents_.push_back(parent);
  }
  if (final.has_parent_path()) fs::create_directories(final.parent_path(), error);
  if (error) return io_error(directory, "cannot be made: " + error.message());
  const auto temporary =
      unique_sibling(final, [](const fs::path& name) { return ::mkdir(name.c_str(), 0777) == 0; });
  if (!temporary) return io_error(directory, "cannot be made: " + reason(errno));
  output.temporary_ = *temporary;
  return output;
}

OutputDir::OutputDir(OutputDir&& other) noexcept
    : temporary_(std::exchange(other.temporary_, {})),
      final_(std::move(other.final_)),
      made_parents_(std::exchange(other.made_parents_, {})),
      force_(other.force_) {}

OutputDir& OutputDir::operator=(OutputDir&& other) noexcept {
  if (this == &other) return *this;
  discard();
  temporary_ = std::exchange(other.temporary_, {});
  final_ = std::move(other.final_);
  made_parents_ = std::exchange(other.made_parents_, {});
  force_ = other.force_;
  return *this;
}

OutputDir::~OutputDir() { discard(); }

void OutputDir::discard() noexcept {
  std::error_code ignored;
  if (!temporary_.empty()) fs::remove_all(temporary_, ignored);
  temporary_.clear();
  for (const fs::path& parent : made_parents_) fs::remove(parent, ignored);  // only where it is empty
  made_parents_.clear();
}

Status OutputDir::write(const std::string& name, std::string_view bytes) const {
  PLUMBLINE_CHECK(!temporary_.empty(), "the directory was committed already");
  const fs::path relative = fs::path(name).lexically_normal();
  // Camera names come from files of strangers.
  if (relative.empty() || relative.is_absolute() || !relative.has_filename() || *relative.begin() == ".." ||
      relative == "." || name.find('\0') != std::string::npos) {
    return Error{ErrorCode::kInvalidData, fmt::format("'{}' cannot be the name of a file in it", name),
                 final_.string()};
  }
  const fs::path file = temporary_ / relative;
  std::error_code error;
  fs::create_directories(file.parent_path(), error);
  if (error) return io_error(final_ / relative, "cannot be written: " + error.message());
  Status written = write_file(file, bytes, false);
  if (!written) return io_error(final_ / relative, written.error().message);
  return {};
}

Status OutputDir::commit() {
  PLUMBLINE_CHECK(!temporary_.empty(), "the directory was committed already");
  std::error_code ignored;
  const bool replace = force_ && fs::is_directory(final_, ignored);
  // Again: hours may have passed since create().
  if (Status fit = replace ? check_replaceable(final_) : Status(); !fit) return fit;
  const int error = replace ? replace_directory(temporary_, final_) : rename_to_new(temporary_, final_);
  if (error == EEXIST) return io_error(final_, kExists);
  if (error != 0) return io_error(final_, "cannot be put in its place: " + reason(error));
  temporary_.clear();
  made_parents_.clear();
  return {};
}

}  // namespace plumbline
