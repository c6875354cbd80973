# The modules: each is a shared object of its own, loaded on first use.  C++, but for films, TIFF and MPI.
MPI := $(shell pkg-config --exists ompi-c 2>/dev/null && echo 1)
LIBCAMERA := $(shell pkg-config --exists libcamera 2>/dev/null && echo 1)
OPENVDB := $(if $(wildcard /usr/include/openvdb/openvdb.h),$(wildcard /usr/include/nanovdb/NanoVDB.h))
MODULES := films tiff aruco calib $(if $(LIBCAMERA),libcamera) $(if $(OPENVDB),openvdb) $(if $(MPI),mpi)
PLUGINS := $(patsubst %,$(B)/lib/pyrovox/pyrovox-%.so,$(MODULES))
# Those in C++ are not instrumented: a build with a sanitizer takes them from the build without.
CXX_FOLDER := $(if $(SAN),build,$(B))
CXX_PLUGINS := $(patsubst %,$(CXX_FOLDER)/lib/pyrovox/pyrovox-%.so,$(filter-out films tiff mpi,$(MODULES)))

module_flags = -I. -Idaemon -DPVX_VERSION='"$(VERSION)"' $(MODULE_INCLUDES) $(CXXFLAGS)
module_ldflags = $(filter-out -fsanitize=%,$(LDFLAGS))
$(PLUGINS) $(CXX_PLUGINS): Makefile daemon/modules.mk
$(CXX_PLUGINS):
	@mkdir -p $(@D)
	$(call say,CXX)
	$(Q)$(CXX) $(module_flags) -shared $(module_ldflags) -o $@ $(filter %.cpp,$^) $(MODULE_LIBS)
ifdef SAN
$(CXX_PLUGINS:build/%=$(B)/%): $(B)/%: build/%
	@mkdir -p $(@D)
	@cp $< $@
endif

ARUCO := $(CXX_FOLDER)/lib/pyrovox/pyrovox-aruco.so
$(ARUCO): recon/board/aruco_shim.cpp recon/board/aruco_shim.h
$(ARUCO): MODULE_INCLUDES = -I/usr/include/opencv4
$(ARUCO): MODULE_LIBS = $(addprefix -lopencv_,aruco calib3d imgproc core)

# Least squares by Ceres, planes by OpenCV: one C++ file, since the headers of both are most of its cost.
CALIB := $(CXX_FOLDER)/lib/pyrovox/pyrovox-calib.so
$(CALIB): recon/calib/shim.cpp recon/calib/shim.h daemon/base/guarded.hpp
$(CALIB): MODULE_INCLUDES = -I/usr/include/opencv4 -isystem /usr/include/eigen3
$(CALIB): MODULE_LIBS = -lceres -lglog -lopencv_core -lopencv_calib3d

LIBCAMERA_SO := $(CXX_FOLDER)/lib/pyrovox/pyrovox-libcamera.so
$(LIBCAMERA_SO): capture/libcamera/shim.cpp capture/libcamera/shim.h daemon/base/guarded.hpp
$(LIBCAMERA_SO): MODULE_INCLUDES = $(shell pkg-config --cflags libcamera)
$(LIBCAMERA_SO): CXXFLAGS += -std=c++20
$(LIBCAMERA_SO): MODULE_LIBS = $(shell pkg-config --libs libcamera)

# The headers of OpenVDB warn; most of the library's own cost is theirs too.
VDB := $(CXX_FOLDER)/lib/pyrovox/pyrovox-openvdb.so
$(VDB): $(addprefix daemon/volumes/,openvdb_shim.cpp nanovdb_grids.cpp openvdb_shim.h nanovdb_grids.h)
$(VDB): daemon/base/guarded.hpp
$(VDB): MODULE_LIBS = -lopenvdb -ltbb -lImath-3_1 -Wl,--gc-sections -s

# In C, since MPI has a C API.
$(B)/daemon/cli/reconstruct/ranks_mpi.%: pkg_cflags = $(shell pkg-config --cflags ompi-c)
$(B)/lib/pyrovox/pyrovox-mpi.so: $(B)/daemon/cli/reconstruct/ranks_mpi.o
	@mkdir -p $(@D)
	$(call say,LD)
	$(Q)$(CC) -shared $(CFLAGS) $(module_ldflags) -o $@ $(filter %.o,$^) $$(pkg-config --libs ompi-c)

FILMS := $(B)/lib/pyrovox/pyrovox-films.so
$(B)/capture/files/film_pixels.o: CFLAGS += $(FAST)
$(FILMS): $(FILMS_SOURCES:%.c=$(B)/%.o)
	@mkdir -p $(@D)
	$(call say,LD)
	$(Q)$(CC) -shared $(CFLAGS) $(module_ldflags) -o $@ $(filter %.o,$^) -lavformat -lavcodec -lavutil

TIFF := $(B)/lib/pyrovox/pyrovox-tiff.so
$(TIFF): $(B)/capture/files/tiff.o
	@mkdir -p $(@D)
	$(call say,LD)
	$(Q)$(CC) -shared $(CFLAGS) $(module_ldflags) -o $@ $(filter %.o,$^) -ltiff
