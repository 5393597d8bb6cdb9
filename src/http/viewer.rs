//! What shows a fitted material: its texture and parameters, the response, the lights, the object as it was seen, and meshes.

use super::extract::{NoQuery, Path, Query, SessionId};
use super::problem::Problem;
use super::results::{Binary, nothing_yet};
use super::{HttpState, ask};
use crate::session::handle::{Curves, EngineError, EngineHandle, ShownLight, Texture, checked_mesh, shape};
use axum::body::Bytes;
use axum::extract::{DefaultBodyLimit, FromRequest, Request, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use std::time::Duration;
use tokio::sync::Semaphore;
use utoipa::{IntoParams, ToSchema};
use utoipa_axum::router::{OpenApiRouter, UtoipaMethodRouterExt};
use utoipa_axum::routes;

/// Largest mesh that is taken, bytes.
const LARGEST_MESH: usize = 32 << 20;
/// Longest time a mesh may take to come.
const MESH: Duration = Duration::from_secs(60);

/// One of these at a time: maps of a full frame, and meshes, are much of the memory that a night leaves.
static TURN: Semaphore = Semaphore::const_new(1);
/// One mesh at a time comes in and is held; while it comes, the others have their turns.
static BODY: Semaphore = Semaphore::const_new(1);

/// Asks the engine in turn; the turn ends when the work does, not when the client goes away.
async fn ask_in_turn<T: Send + 'static>(
    state: &HttpState,
    question: impl FnOnce(&EngineHandle) -> Result<T, EngineError> + Send + 'static,
) -> Result<T, Problem> {
    let turn = TURN.acquire().await.map_err(|_| Problem::internal())?;
    ask(state, move |engine| {
        let answer = question(engine);
        drop(turn);
        answer
    })
    .await
}

#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct Cut {
    /// Side of the square of the weight map that becomes the texture, pixels; 64 if left out.
    #[param(minimum = 8, maximum = 256, required = false, nullable = false)]
    patch: Option<u16>,
}

/// The material as a texture
///
/// The texture that `rigd render --patch` cuts: the best measured square of the weight map, made to repeat without a seam, and the
/// parameters of the BRDF model.
#[utoipa::path(get, path = "/v1/sessions/{id}/texture", tag = "viewer", params(("id" = String, Path, description = "Session id."), Cut),
    responses(
        (status = 200, body = Texture, description = "Texture and parameters."),
        (status = 400, description = "A wrong query, or the path is no UTF-8."),
        (status = 404, description = "No such session."),
        (status = 409, description = "No material in `current_state`."),
        (status = 422, description = "No square of that side was measured throughout; `detail` says the largest there is."),
    ))]
pub(super) async fn texture(
    State(state): State<HttpState>,
    SessionId(id): SessionId,
    Query(Cut { patch }): Query<Cut>,
) -> Result<axum::Json<Texture>, Problem> {
    let side = within("patch", patch.unwrap_or(64), 8, 256).map_err(Problem::bad_request)?;
    let asked = id.clone();
    match ask_in_turn(&state, move |engine| engine.texture(&asked, side)).await? {
        Some(texture) => Ok(axum::Json(texture)),
        None => Err(nothing_yet(&state, id, "material").await),
    }
}

fn within(name: &str, value: u16, least: u16, most: u16) -> Result<usize, String> {
    if (least..=most).contains(&value) { Ok(value.into()) } else { Err(format!("{name}: write {least} to {most}")) }
}

/// The response through which a session's pictures are shown
///
/// That of the calibration which it used; where none is known, levels as sRGB has them.
#[utoipa::path(get, path = "/v1/sessions/{id}/response", tag = "viewer", params(("id" = String, Path, description = "Session id.")),
    responses(
        (status = 200, body = Curves, description = "The curves."),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No such session."),
    ))]
pub(super) async fn response(
    State(state): State<HttpState>,
    SessionId(id): SessionId,
) -> Result<axum::Json<Curves>, Problem> {
    ask(&state, move |engine| engine.response(&id)).await.map(axum::Json)
}

/// Lights of a session.
#[derive(Serialize, Deserialize, ToSchema)]
pub(super) struct Lights {
    /// In the order of the stations.
    lights: Vec<ShownLight>,
}

/// The lights of a session
///
/// As its fit used them: camera frame (x right, y down, z forward), mm.
#[utoipa::path(get, path = "/v1/sessions/{id}/lights", tag = "viewer", params(("id" = String, Path, description = "Session id.")),
    responses(
        (status = 200, body = Lights, description = "One a station."),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No such session."),
        (status = 409, description = "No material in `current_state`."),
    ))]
pub(super) async fn lights(
    State(state): State<HttpState>,
    SessionId(id): SessionId,
) -> Result<axum::Json<Lights>, Problem> {
    let asked = id.clone();
    match ask(&state, move |engine| engine.lights(&asked)).await? {
        Some(lights) => Ok(axum::Json(Lights { lights })),
        None => Err(nothing_yet(&state, id, "material").await),
    }
}

#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct Thinned {
    /// Most columns and rows: of a larger frame every so many-th pixel is taken. 512 if left out.
    #[param(minimum = 16, maximum = 1024, required = false, nullable = false)]
    most: Option<u16>,
}

/// The object as the camera saw it
///
/// An OpenEXR file of the part of the frame that was measured: `position`, `normal` and `view` (towards the camera), each X, Y, Z in the
/// camera's frame, mm; the weights `material_1`..., their standard errors `sigma_1`..., and the `residual` of the fit (R, G, B). Pixels
/// are picked, never averaged.
#[utoipa::path(get, path = "/v1/sessions/{id}/surface", tag = "viewer", params(("id" = String, Path, description = "Session id."), Thinned),
    responses(
        (status = 200, description = "The maps.", content((Binary = "image/x-exr"))),
        (status = 400, description = "A wrong query, or the path is no UTF-8."),
        (status = 404, description = "No such session."),
        (status = 409, description = "No material in `current_state`."),
        (status = 422, description = "Nothing was measured."),
    ))]
pub(super) async fn surface(
    State(state): State<HttpState>,
    SessionId(id): SessionId,
    Query(Thinned { most }): Query<Thinned>,
) -> Result<Response, Problem> {
    let most = within("most", most.unwrap_or(512), 16, 1024).map_err(Problem::bad_request)?;
    let asked = id.clone();
    match ask_in_turn(&state, move |engine| engine.surface(&asked, most)).await? {
        Some(bytes) => Ok(answer("image/x-exr", bytes)),
        None => Err(nothing_yet(&state, id, "material").await),
    }
}

#[derive(Deserialize)]
pub(super) struct LightPath {
    light: String,
}

/// What was measured under a light
///
/// An OpenEXR file of the same pixels as `.../surface` with the same query: radiance R, G, B, and `valid`, 1 where it is known.
#[utoipa::path(get, path = "/v1/sessions/{id}/surface/{light}", tag = "viewer",
    params(("id" = String, Path, description = "Session id."), ("light" = usize, Path, description = "Light, from 0."), Thinned),
    responses(
        (status = 200, description = "The radiance.", content((Binary = "image/x-exr"))),
        (status = 400, description = "A wrong query, or the path is no UTF-8."),
        (status = 404, description = "No such session, or no light of that number."),
        (status = 409, description = "No material in `current_state`."),
        (status = 422, description = "Nothing was measured."),
    ))]
pub(super) async fn photograph(
    State(state): State<HttpState>,
    SessionId(id): SessionId,
    Path(LightPath { light }): Path<LightPath>,
    Query(Thinned { most }): Query<Thinned>,
) -> Result<Response, Problem> {
    let most = within("most", most.unwrap_or(512), 16, 1024).map_err(Problem::bad_request)?;
    let Ok(light) = light.parse::<usize>() else {
        return Err(Problem::not_found("a light is a number from 0: GET .../lights lists them"));
    };
    let asked = id.clone();
    match ask_in_turn(&state, move |engine| engine.photograph(&asked, light, most)).await? {
        Some(bytes) => Ok(answer("image/x-exr", bytes)),
        None => Err(nothing_yet(&state, id, "material").await),
    }
}

fn answer(kind: &'static str, bytes: Vec<u8>) -> Response {
    ([(header::CONTENT_TYPE, kind)], bytes).into_response()
}

const GLB: &str = "model/gltf-binary";

/// Name of a mesh that comes with rigd.
#[derive(ToSchema)]
#[schema(rename_all = "lowercase")]
#[allow(dead_code, reason = "only its schema is used")]
enum ShapeName {
    Sphere,
    Cylinder,
    Knot,
}

#[derive(Deserialize)]
pub(super) struct ShapePath {
    name: String,
}

/// A mesh that comes with rigd
///
/// As glTF in one piece. The node's scale and translation put it where it is in `rigd render`; its `extras` say `extent`, its longest side.
#[utoipa::path(get, path = "/v1/meshes/{name}", tag = "viewer", params(("name" = inline(ShapeName), Path, description = "Its name.")),
    responses(
        (status = 200, description = "The mesh.", content((Binary = "model/gltf-binary"))),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No mesh of that name."),
    ))]
pub(super) async fn bundled(
    State(state): State<HttpState>,
    Path(ShapePath { name }): Path<ShapePath>,
) -> Result<Response, Problem> {
    match ask(&state, move |_| Ok(shape(&name))).await? {
        Some(bytes) => Ok(answer(GLB, bytes)),
        None => Err(Problem::not_found("no mesh of that name comes with rigd: sphere, cylinder, knot")),
    }
}

/// Check a mesh and make triangles of it
///
/// Nothing is kept. OBJ and glTF (as .glb, or as .gltf with its buffers in the description), up to 32 MiB, become the triangles that
/// `rigd render` would show: polygons cut, normals made where there are none, triangles without area left out.
#[utoipa::path(post, path = "/v1/meshes", tag = "viewer",
    request_body(description = "The file.", content((Binary = "model/obj"), (Binary = "model/gltf-binary"), (Binary = "model/gltf+json"))),
    responses(
        (status = 200, description = "The mesh, as glTF in one piece.", content((Binary = "model/gltf-binary"))),
        (status = 400, description = "A wrong query, or the body breaks off."),
        (status = 408, description = "The body does not come in time."),
        (status = 413, description = "The body is larger than 32 MiB."),
        (status = 415, description = "The Content-Type names neither OBJ nor glTF."),
        (status = 422, description = "The file holds no mesh that can be shown; `detail` says why."),
    ))]
pub(super) async fn mesh(
    State(state): State<HttpState>,
    Query(NoQuery {}): Query<NoQuery>,
    request: Request,
) -> Result<Response, Problem> {
    let kind = request.headers().get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    let ending = match kind.split(';').next().map(str::trim) {
        Some("model/obj") => "obj",
        Some(GLB | "model/gltf+json") => "glb",
        _ => {
            let detail =
                "send the mesh with `Content-Type: model/obj`, `model/gltf-binary` (.glb) or `model/gltf+json` (.gltf)";
            return Err(Problem::wrong_type(detail));
        }
    };
    let held = BODY.acquire().await.map_err(|_| Problem::internal())?;
    let bytes = body(request).await?;
    let bytes = ask_in_turn(&state, move |_| {
        let made = checked_mesh(ending, &bytes);
        drop((bytes, held));
        made
    })
    .await?;
    Ok(answer(GLB, bytes))
}

/// The body, as far as the limit of [`routes`] lets it in.
async fn body(request: Request) -> Result<Bytes, Problem> {
    let read = tokio::time::timeout(MESH, Bytes::from_request(request, &())).await;
    read.map_err(|_| Problem::too_slow())?.map_err(|rejection| match rejection.status() {
        StatusCode::PAYLOAD_TOO_LARGE => Problem::too_large(LARGEST_MESH),
        _ => Problem::bad_request("the body broke off: send it again"),
    })
}

/// The routes, with the one larger body.
pub(super) fn routes() -> OpenApiRouter<HttpState> {
    OpenApiRouter::new()
        .routes(routes!(texture))
        .routes(routes!(response))
        .routes(routes!(lights))
        .routes(routes!(surface))
        .routes(routes!(photograph))
        .routes(routes!(bundled))
        .routes(routes!(mesh).layer(DefaultBodyLimit::max(LARGEST_MESH)))
}
