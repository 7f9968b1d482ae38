"""Scans by Open3D, trimesh and small_gicp: distances to a mesh, registration, and finding a part in a scene.

scans_oracle.py distance MESH CLOUD   stdout: a line a point, its distance to the mesh in mm by trimesh in double precision and by
                                      open3d.t RaycastingScene in single
scans_oracle.py register MESH CLOUD   stdout: a line an engine, its name and the 16 numbers of mesh_from_cloud, row by row; the cloud
                                      lies within a few degrees and millimetres of the mesh (point to plane, Tukey's weights)
scans_oracle.py find MODEL SCENE      stdout: a line a seed, the 16 numbers of scene_from_model (FPFH, RANSAC, point to plane)

MESH and MODEL are STL or PLY, CLOUD and SCENE are PLY, all in millimetres.
"""

import sys

import numpy as np
import open3d as o3d
import small_gicp
import trimesh

SAMPLES = 400_000
SEEDS = (1, 2, 3)


def finite(path):
    cloud = o3d.io.read_point_cloud(path, remove_nan_points=True, remove_infinite_points=True)
    return cloud


def distance(mesh_path, cloud_path):
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(o3d.io.read_triangle_mesh(mesh_path)))
    points = np.asarray(finite(cloud_path).points)
    single = scene.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy()
    _, double, _ = trimesh.proximity.closest_point(trimesh.load_mesh(mesh_path, process=False), points)
    sys.stdout.writelines(f"{one:.17g} {other:.9g}\n" for one, other in zip(double, single))


def show(name, pose):
    print(name, *(f"{value:.17g}" for value in np.asarray(pose).ravel()))


def register(mesh_path, cloud_path):
    mesh = o3d.io.read_triangle_mesh(mesh_path)
    mesh.compute_triangle_normals()
    o3d.utility.random.seed(1)
    # Normals of the triangles, not those of vertices, which blend across edges.
    target = mesh.sample_points_uniformly(SAMPLES, use_triangle_normal=True)
    source = finite(cloud_path)
    icp = o3d.pipelines.registration
    pose = np.eye(4)
    for reach_mm in (5.0, 1.0, 0.3):
        estimation = icp.TransformationEstimationPointToPlane(icp.TukeyLoss(k=reach_mm))
        criteria = icp.ICPConvergenceCriteria(1e-12, 1e-12, 200)
        pose = icp.registration_icp(source, target, reach_mm, pose, estimation, criteria).transformation
    show("open3d", pose)
    points, _ = small_gicp.preprocess_points(np.asarray(source.points), downsampling_resolution=0.5, num_threads=2)
    model, tree = small_gicp.preprocess_points(np.asarray(target.points), downsampling_resolution=0.25, num_threads=2)
    pose = np.eye(4)
    for reach_mm in (5.0, 1.0):
        found = small_gicp.align(model, points, tree, init_T_target_source=pose, registration_type="GICP",
                                 max_correspondence_distance=reach_mm, num_threads=2, max_iterations=100)
        pose = found.T_target_source
    show("small_gicp", pose)


def find(model_path, scene_path):
    icp = o3d.pipelines.registration
    voxel_mm = 5.0

    def prepared(cloud):
        cloud = cloud.voxel_down_sample(voxel_mm)
        cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=2 * voxel_mm, max_nn=30))
        cloud.orient_normals_towards_camera_location(np.zeros(3))
        features = icp.compute_fpfh_feature(cloud, o3d.geometry.KDTreeSearchParamHybrid(radius=5 * voxel_mm, max_nn=100))
        return cloud, features

    mesh = o3d.io.read_triangle_mesh(model_path)
    mesh.compute_vertex_normals()
    model = o3d.geometry.PointCloud(mesh.vertices)
    model.normals = mesh.vertex_normals
    coarse = model.voxel_down_sample(voxel_mm)
    coarse_features = icp.compute_fpfh_feature(coarse, o3d.geometry.KDTreeSearchParamHybrid(radius=5 * voxel_mm, max_nn=100))
    scene = finite(scene_path)
    scene.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=5.0, max_nn=30))
    scene.orient_normals_towards_camera_location(np.zeros(3))
    coarse_scene, scene_features = prepared(finite(scene_path))
    for seed in SEEDS:
        o3d.utility.random.seed(seed)
        found = icp.registration_ransac_based_on_feature_matching(
            coarse, coarse_scene, coarse_features, scene_features, True, 1.5 * voxel_mm,
            icp.TransformationEstimationPointToPoint(False), 4,
            [icp.CorrespondenceCheckerBasedOnEdgeLength(0.9), icp.CorrespondenceCheckerBasedOnDistance(1.5 * voxel_mm)],
            icp.RANSACConvergenceCriteria(1_000_000, 0.9999))
        # Points of the scene against planes of the model: a scan shows a part of it.
        inverse = np.linalg.inv(found.transformation)
        for reach_mm in (10.0, 4.0, 2.0):
            inverse = icp.registration_icp(scene, model, reach_mm, inverse,
                                           icp.TransformationEstimationPointToPlane(icp.TukeyLoss(k=reach_mm)),
                                           icp.ICPConvergenceCriteria(1e-10, 1e-10, 200)).transformation
        pose = np.linalg.inv(inverse)
        print(*(f"{value:.17g}" for value in np.asarray(pose).ravel()))


if __name__ == "__main__":
    {"distance": distance, "register": register, "find": find}[sys.argv[1]](*sys.argv[2:])
