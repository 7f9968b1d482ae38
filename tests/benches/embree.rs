//! Embree 3.13 with packets of 16 rays, the fastest published ray caster for these CPUs, as yardstick and oracle. The
//! library is the system's (Debian: libembree3-3), opened at run time; nothing is linked.
//!
//! The only benchmark file with `unsafe`. What it rests on, besides the layouts of the C header that the types below
//! repeat: the library is never closed, since its worker threads outlive the scenes, so that what is taken from it lives
//! as long as the process; a committed scene is never changed again, and Embree allows any number of threads to query
//! such a scene; the buffers that a scene reads are filled by us to the size Embree was told, before it is committed.

#![expect(unsafe_code, reason = "calls a C library that is opened at run time")]

use std::ffi::{c_char, c_int, c_uint, c_void};
use std::ptr::{null, null_mut};

use libloading::{Library, Symbol};
use vantage::geometry::Mesh;

/// Rays a packet.
pub(crate) const WIDTH: usize = 16;
/// The face of a ray that meets nothing.
pub(crate) const NO_FACE: u32 = u32::MAX;

const LIBRARY: &str = "libembree3.so.3";
const TRIANGLES: c_uint = 0;
const INDEX_BUFFER: c_uint = 0;
const VERTEX_BUFFER: c_uint = 1;
const UINT3: c_uint = 0x5003;
const FLOAT3: c_uint = 0x9003;
const ROBUST: c_uint = 1 << 2;

type Handle = *mut c_void;

/// `RTCRay16`.
#[repr(C, align(64))]
#[derive(Clone)]
struct Rays {
    origin: [[f32; WIDTH]; 3],
    near: [f32; WIDTH],
    direction: [[f32; WIDTH]; 3],
    time: [f32; WIDTH],
    far: [f32; WIDTH],
    mask: [u32; WIDTH],
    id: [u32; WIDTH],
    flags: [u32; WIDTH],
}

/// `RTCHit16`.
#[repr(C, align(64))]
#[derive(Clone)]
struct Hits {
    normal: [[f32; WIDTH]; 3],
    uv: [[f32; WIDTH]; 2],
    face: [u32; WIDTH],
    geometry: [u32; WIDTH],
    instance: [u32; WIDTH],
}

/// `RTCRayHit16`.
#[repr(C, align(64))]
#[derive(Clone)]
struct RaysAndHits {
    rays: Rays,
    hits: Hits,
}

/// `RTCIntersectContext`, as `rtcInitIntersectContext` fills it, but for coherent rays.
#[repr(C)]
struct Query {
    flags: c_uint,
    filter: *const c_void,
    instance: c_uint,
    /// Present in builds with minimal curve widths; never read for triangles.
    min_width_distance_factor: f32,
}

const COHERENT: c_uint = 1;

type Intersect = unsafe extern "C" fn(*const c_int, Handle, *mut Query, *mut RaysAndHits);
type Occluded = unsafe extern "C" fn(*const c_int, Handle, *mut Query, *mut Rays);

/// The library.
pub(crate) struct Embree(&'static Library);

/// A mesh with its tree.
pub(crate) struct EmbreeScene {
    handle: Handle,
    device: Handle,
    intersect: Intersect,
    occluded: Occluded,
    library: &'static Library,
}

// SAFETY: the handles are pointers to objects with atomic reference counts; queries of a committed scene change nothing.
unsafe impl Send for EmbreeScene {}
// SAFETY: as above.
unsafe impl Sync for EmbreeScene {}

impl Embree {
    /// Opens the library; or says why it cannot.
    pub(crate) fn open() -> Result<Self, String> {
        // SAFETY: Debian's library runs nothing at loading but the constructors of its own C++ globals.
        let library = unsafe { Library::new(LIBRARY) };
        library.map(|library| Self(Box::leak(Box::new(library)))).map_err(|_| format!("{LIBRARY} (Embree 3) is not installed"))
    }

    /// Builds the tree of `mesh`, on all cores. `robust` asks for watertight intersections.
    pub(crate) fn scene(&self, mesh: &Mesh, robust: bool) -> EmbreeScene {
        type NewDevice = unsafe extern "C" fn(*const c_char) -> Handle;
        type New = unsafe extern "C" fn(Handle) -> Handle;
        type NewGeometry = unsafe extern "C" fn(Handle, c_uint) -> Handle;
        type NewBuffer = unsafe extern "C" fn(Handle, c_uint, c_uint, c_uint, usize, usize) -> Handle;
        type SetFlags = unsafe extern "C" fn(Handle, c_uint);
        type Attach = unsafe extern "C" fn(Handle, Handle) -> c_uint;
        type Act = unsafe extern "C" fn(Handle);
        let library = self.0;
        // SAFETY: the signatures are those of Embree 3.13's headers; every handle is one the library gave and has not
        // released, and each buffer holds as many items as are written to it.
        unsafe {
            let device = function::<NewDevice>(library, "rtcNewDevice")(null());
            let scene = function::<New>(library, "rtcNewScene")(device);
            function::<SetFlags>(library, "rtcSetSceneFlags")(scene, if robust { ROBUST } else { 0 });
            let geometry = function::<NewGeometry>(library, "rtcNewGeometry")(device, TRIANGLES);
            let buffer = function::<NewBuffer>(library, "rtcSetNewGeometryBuffer");
            let vertices = buffer(geometry, VERTEX_BUFFER, 0, FLOAT3, 12, mesh.vertices_mm.len()).cast::<[f32; 3]>();
            for (index, p) in mesh.vertices_mm.iter().enumerate() {
                vertices.add(index).write(p.map(|x| x as f32).into());
            }
            let faces = buffer(geometry, INDEX_BUFFER, 0, UINT3, 12, mesh.faces.len()).cast::<[u32; 3]>();
            faces.copy_from_nonoverlapping(mesh.faces.as_ptr(), mesh.faces.len());
            function::<Act>(library, "rtcCommitGeometry")(geometry);
            function::<Attach>(library, "rtcAttachGeometry")(scene, geometry);
            function::<Act>(library, "rtcReleaseGeometry")(geometry);
            function::<Act>(library, "rtcCommitScene")(scene);
            EmbreeScene {
                handle: scene,
                device,
                intersect: function::<Intersect>(library, "rtcIntersect16"),
                occluded: function::<Occluded>(library, "rtcOccluded16"),
                library,
            }
        }
    }
}

/// # Safety
/// `name` has the type `F` in the library, and is called as the C header says.
unsafe fn function<F: Copy>(library: &'static Library, name: &str) -> F {
    // SAFETY: the caller's promise.
    let symbol: Symbol<'_, F> = unsafe { library.get(name) }.expect("Embree 3 has it");
    *symbol
}

impl EmbreeScene {
    /// The first face that each ray from `origin` meets, [`NO_FACE`] where there is none.
    pub(crate) fn first_faces(&self, origin: [f32; 3], directions: &[[f32; 3]], faces: &mut [u32]) {
        let mut packet = RaysAndHits { rays: rays_from(origin), hits: no_hits() };
        for (directions, faces) in directions.chunks(WIDTH).zip(faces.chunks_mut(WIDTH)) {
            let valid = aim(&mut packet.rays, directions, f32::INFINITY);
            packet.hits.geometry = [NO_FACE; WIDTH];
            packet.hits.face = [NO_FACE; WIDTH];
            // SAFETY: the scene is committed and alive; the packet, the mask and the query are ours, of the header's
            // layout, and aligned to 64 bytes as packets of 16 must be.
            unsafe { (self.intersect)(valid.0.as_ptr(), self.handle, &mut query(), &mut packet) };
            faces.copy_from_slice(&packet.hits.face[..faces.len()]);
        }
    }

    /// Finds whether anything lies on `origin + t·direction`, 0 < t < `end`.
    pub(crate) fn blocked(&self, origin: [f32; 3], directions: &[[f32; 3]], end: f32, blocked: &mut [bool]) {
        let mut packet = rays_from(origin);
        for (directions, blocked) in directions.chunks(WIDTH).zip(blocked.chunks_mut(WIDTH)) {
            let valid = aim(&mut packet, directions, end);
            // SAFETY: as in `first_faces`.
            unsafe { (self.occluded)(valid.0.as_ptr(), self.handle, &mut query(), &mut packet) };
            // Embree marks an occluded ray by an end at minus infinity.
            blocked.iter_mut().zip(packet.far).for_each(|(blocked, far)| *blocked = far < 0.0);
        }
    }
}

impl Drop for EmbreeScene {
    fn drop(&mut self) {
        type Release = unsafe extern "C" fn(Handle);
        // SAFETY: both handles are released once, here; nothing can query the scene any more.
        unsafe {
            function::<Release>(self.library, "rtcReleaseScene")(self.handle);
            function::<Release>(self.library, "rtcReleaseDevice")(self.device);
        }
    }
}

/// −1 for a ray that is to be cast, 0 for one that is not.
#[repr(align(64))]
struct Valid([c_int; WIDTH]);

fn query() -> Query {
    Query { flags: COHERENT, filter: null_mut(), instance: NO_FACE, min_width_distance_factor: 0.0 }
}

fn rays_from(origin: [f32; 3]) -> Rays {
    Rays {
        origin: origin.map(|x| [x; WIDTH]),
        near: [0.0; WIDTH],
        direction: [[0.0; WIDTH]; 3],
        time: [0.0; WIDTH],
        far: [0.0; WIDTH],
        mask: [u32::MAX; WIDTH],
        id: [0; WIDTH],
        flags: [0; WIDTH],
    }
}

fn no_hits() -> Hits {
    Hits {
        normal: [[0.0; WIDTH]; 3],
        uv: [[0.0; WIDTH]; 2],
        face: [NO_FACE; WIDTH],
        geometry: [NO_FACE; WIDTH],
        instance: [NO_FACE; WIDTH],
    }
}

/// Points the packet; says which of its rays count.
fn aim(rays: &mut Rays, directions: &[[f32; 3]], end: f32) -> Valid {
    for (lane, direction) in directions.iter().enumerate() {
        for (lanes, x) in rays.direction.iter_mut().zip(direction) {
            lanes[lane] = *x;
        }
    }
    rays.far = [end; WIDTH];
    Valid(std::array::from_fn(|lane| if lane < directions.len() { -1 } else { 0 }))
}
