#include "wirebond/posix/appearance.hpp"

#include <doctest/doctest.h>
#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/stat.h>

#include <filesystem>
#include <string>

using wirebond::posix::Appearance;

namespace {

/// A new folder, which is removed at the end with its content.
class Folder {
 public:
  Folder() {
    std::string name = (std::filesystem::temp_directory_path() / "wirebond_XXXXXX").string();
    REQUIRE(::mkdtemp(name.data()) != nullptr);
    path_ = name;
  }
  ~Folder() { std::filesystem::remove_all(path_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;

  std::string operator+(const char* inside) const { return path_ + inside; }

 private:
  std::string path_;
};

void watch(Appearance& appearance) {
  appearance.watching([] { return false; });
}

bool has_event(const Appearance& appearance) {
  pollfd waiting{appearance.get(), POLLIN, 0};
  return ::poll(&waiting, 1, 0) == 1;
}

void make_file(const std::string& path) { ::close(::open(path.c_str(), O_CREAT | O_WRONLY, 0600)); }

}  // namespace

TEST_CASE("a file that appears in the folder is reported") {
  const Folder folder;
  Appearance appearance(folder + "/tty");
  CHECK(appearance.get() < 0);
  CHECK(!appearance.changed());
  watch(appearance);
  CHECK(!has_event(appearance));
  make_file(folder + "/tty");
  CHECK(has_event(appearance));
  CHECK(appearance.changed());
  CHECK(!appearance.changed());
  ::chmod((folder + "/tty").c_str(), 0666);  // what udev does a moment later
  CHECK(has_event(appearance));
  appearance.stop();
  CHECK(appearance.get() < 0);
}

TEST_CASE("a folder that is not there yet is waited for, step by step") {
  const Folder folder;
  Appearance appearance(folder + "/serial/by-id/arm");
  watch(appearance);
  for (const char* step : {"/serial", "/serial/by-id"}) {
    ::mkdir((folder + step).c_str(), 0700);
    CHECK(has_event(appearance));
    CHECK(appearance.changed());
    CHECK(!has_event(appearance));
  }
  REQUIRE(::symlink("/dev/null", (folder + "/serial/by-id/arm").c_str()) == 0);
  CHECK(appearance.changed());
}

TEST_CASE("a name without a folder lies in the current one") {
  Appearance appearance("tty");
  watch(appearance);
  CHECK(appearance.get() >= 0);
}

TEST_CASE("what appears after the last look is reported, also much later and after a second watch") {
  const Folder folder;
  Appearance appearance(folder + "/tty");
  watch(appearance);
  watch(appearance);
  const int descriptor = appearance.get();
  make_file(folder + "/tty");  // the device is back before its loss shows
  CHECK(appearance.changed());
  watch(appearance);
  CHECK(appearance.get() == descriptor);  // a new one would lose what appears in between
  make_file(folder + "/other");
  watch(appearance);  // and the caller looks after it
  CHECK(!has_event(appearance));
}

TEST_CASE("a folder that goes away and comes back, as /dev/serial/by-id does, is watched again") {
  const Folder folder;
  const std::string by_id = folder + "/by-id";
  ::mkdir(by_id.c_str(), 0700);
  Appearance appearance(by_id + "/arm");
  watch(appearance);
  ::rmdir(by_id.c_str());
  CHECK(appearance.changed());
  ::mkdir(by_id.c_str(), 0700);
  CHECK(appearance.changed());
  REQUIRE(::symlink("/dev/null", (by_id + "/arm").c_str()) == 0);
  CHECK(appearance.changed());
}

TEST_CASE("what appears while it is tried is reported after it") {
  const Folder folder;
  Appearance appearance(folder + "/tty");
  for (const char* name : {"/tty", "/other"}) {
    const bool is_open = appearance.watching([&] {
      make_file(folder + name);
      return false;
    });
    CHECK_FALSE(is_open);
    CHECK(has_event(appearance));
    CHECK(appearance.changed());
  }
}

TEST_CASE("what has no path is not watched") {
  Appearance appearance("");
  CHECK(appearance.watching([] { return true; }));
  CHECK(appearance.get() < 0);
  CHECK_FALSE(appearance.changed());
}
