#include "wirebond/posix/appearance.hpp"

#include <doctest/doctest.h>
#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/stat.h>

#include <string>

using wirebond::posix::Appearance;

namespace {

std::string new_folder() {
  char name[] = "/tmp/wirebond_appearance_XXXXXX";
  REQUIRE(::mkdtemp(name) != nullptr);
  return name;
}

bool is_told(const Appearance& appearance) {
  pollfd waiting{appearance.get(), POLLIN, 0};
  return ::poll(&waiting, 1, 0) == 1;
}

void make_file(const std::string& path) { ::close(::open(path.c_str(), O_CREAT | O_WRONLY, 0600)); }

}  // namespace

TEST_CASE("a file that appears in the folder is reported") {
  const std::string folder = new_folder();
  Appearance appearance(folder + "/tty");
  CHECK(appearance.get() < 0);
  CHECK(!appearance.changed());
  appearance.watch();
  CHECK(!is_told(appearance));
  make_file(folder + "/tty");
  CHECK(is_told(appearance));
  CHECK(appearance.changed());
  CHECK(!appearance.changed());
  ::chmod((folder + "/tty").c_str(), 0666);  // what udev does a moment later
  CHECK(is_told(appearance));
  appearance.stop();
  CHECK(appearance.get() < 0);
}

TEST_CASE("a folder that is not there yet is waited for, step by step") {
  const std::string folder = new_folder();
  Appearance appearance(folder + "/serial/by-id/arm");
  appearance.watch();
  for (const char* step : {"/serial", "/serial/by-id"}) {
    ::mkdir((folder + step).c_str(), 0700);
    CHECK(is_told(appearance));
    CHECK(appearance.changed());
    CHECK(!is_told(appearance));
  }
  REQUIRE(::symlink("/dev/null", (folder + "/serial/by-id/arm").c_str()) == 0);
  CHECK(appearance.changed());
}

TEST_CASE("a name without a folder lies in the current one") {
  Appearance appearance("tty");
  appearance.watch();
  CHECK(appearance.get() >= 0);
}
