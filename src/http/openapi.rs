//! The OpenAPI 3.1 document, made from the handlers' own declarations.

use super::problem::Problem;
use super::{
    HttpState, auth, calibrations, events, live, log, metrics, queue, report, results, rig, sessions, settings, viewer,
};
use crate::session::handle::{GAINS, MAX_MATERIALS, lobes, models, objectives, solvers};
use crate::session::plan::{LEAST_EXPOSURES, MAX_EXPOSURES, MAX_STATIONS};
use axum::body::Bytes;
use axum::http::{Method, header};
use axum::response::{IntoResponse, Response};
use rig_config::{Rig, Shutter};
use std::ops::RangeInclusive;
use utoipa::OpenApi;
use utoipa::openapi::content::ContentBuilder;
use utoipa::openapi::path::Operation;
use utoipa::openapi::response::ResponseBuilder;
use utoipa::openapi::schema::{Array, ArrayItems, Object, Schema};
use utoipa::openapi::security::{Http, HttpAuthScheme, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{self, Ref, RefOr};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

#[derive(OpenApi)]
#[openapi(
    info(title = "rigd", description = "A material-capture daemon: light arm, camera, radiance, fitted material.",
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0")),
    servers((url = "/")),
    components(schemas(Problem)),
    tags(
        (name = "sessions", description = "One acquisition each, from the first light station to the fitted material."),
        (name = "results", description = "Frames, material and result files of a session."),
        (name = "viewer", description = "What shows a fitted material under any light: texture, response, lights, the object as it was seen, meshes."),
        (name = "calibrations", description = "Camera, response and lights, measured step by step with board, card and balls; and the settle time of the arm."),
        (name = "queue", description = "Sessions that wait for their turn."),
        (name = "rig", description = "The rig itself."),
        (name = "health", description = "For supervisors and monitoring."),
    )
)]
struct Document;

/// Problems any operation may answer with.
const ANYWHERE: &[(&str, &str)] = &[
    ("400", "The request cannot be understood."),
    ("421", "The Host header names no loopback address."),
    ("500", "A fault of the daemon, or its storage failed."),
    ("503", "The daemon is ending."),
];

const UNAUTHORIZED: (&str, &str) = ("401", "No token of this daemon's.");
const FORBIDDEN: (&str, &str) = ("403", "The token may only read, or the Origin header names another site.");

pub(super) fn routes() -> OpenApiRouter<HttpState> {
    OpenApiRouter::with_openapi(Document::openapi())
        .routes(routes!(sessions::start, sessions::list))
        .routes(routes!(sessions::show))
        .routes(routes!(sessions::plan))
        .routes(routes!(sessions::pause))
        .routes(routes!(sessions::resume))
        .routes(routes!(sessions::stop))
        .routes(routes!(sessions::abort))
        .routes(routes!(events::events))
        .routes(routes!(calibrations::start, calibrations::list))
        .routes(routes!(calibrations::show))
        .routes(routes!(calibrations::result))
        .routes(routes!(calibrations::shoot))
        .routes(routes!(calibrations::abort))
        .routes(routes!(events::calibration_events))
        .routes(routes!(queue::show, queue::add))
        .routes(routes!(queue::remove))
        .routes(routes!(queue::first))
        .routes(routes!(queue::hold))
        .routes(routes!(queue::release))
        .routes(routes!(results::frames))
        .routes(routes!(results::frame))
        .routes(routes!(results::material))
        .routes(routes!(results::file))
        .routes(routes!(live::fit, results::refit))
        .routes(routes!(live::verified, live::verify))
        .routes(routes!(report::html))
        .routes(routes!(report::pdf))
        .routes(routes!(rig::rig))
        .routes(routes!(settings::settings))
        .routes(routes!(log::log))
        .routes(routes!(rig::livez))
        .routes(routes!(rig::readyz))
        .routes(routes!(metrics::metrics))
        .merge(viewer::routes())
}

/// Name of the one way to say who asks.
const TOKEN: &str = "token";

/// Gives every refusal its body, because handlers name statuses only, and every operation the scope it needs.
fn finish(mut spec: openapi::OpenApi, rig: &Rig, secured: bool) -> openapi::OpenApi {
    for (path, item) in &mut spec.paths.paths {
        for (method, operation) in
            [(Method::GET, &mut item.get), (Method::POST, &mut item.post), (Method::DELETE, &mut item.delete)]
        {
            let Some(operation) = operation else { continue };
            if let Some(scope) = auth::required(&method, path).filter(|_| secured) {
                refuse(operation, UNAUTHORIZED);
                operation.security = Some(vec![SecurityRequirement::new(TOKEN, [scope.name()])]);
            }
            if method != Method::GET {
                refuse(operation, FORBIDDEN);
            }
            complete(operation);
        }
    }
    if let Some(components) = &mut spec.components {
        if secured {
            components.add_security_scheme(TOKEN, SecurityScheme::Http(Http::new(HttpAuthScheme::Bearer)));
        }
        for request in ["StartRequest", "FitRequest", "CalibrationRequest"] {
            bound(components.schemas.get_mut(request), rig);
        }
    }
    spec
}

/// A name that is not blank and holds no control character.
const NAME: &str = r"^[^\x00-\x1f\x7f-\x9f]*[^\s\x00-\x1f\x7f-\x9f][^\x00-\x1f\x7f-\x9f]*$";

/// An id, or a word for one.
const CALIBRATION: &str = "^(latest|none|[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12})$";

/// What a request may hold on this rig, which types alone do not say.
fn bound(request: Option<&mut RefOr<Schema>>, rig: &Rig) {
    let Some(RefOr::T(Schema::Object(request))) = request else { return };
    let [lower, upper] = rig.arm.travel_deg;
    for (key, property) in &mut request.properties {
        match (key.as_str(), property) {
            ("name", RefOr::T(Schema::Object(text))) => text.pattern = Some(NAME.into()),
            ("calibration", RefOr::T(Schema::Object(text))) => text.pattern = Some(CALIBRATION.into()),
            ("stations_deg", RefOr::T(Schema::Array(list))) => bound_items(list, 1..=MAX_STATIONS, |angle| {
                (angle.minimum, angle.maximum) = (Some(lower.into()), Some(upper.into()));
            }),
            ("exposures", RefOr::T(Schema::Array(list))) => {
                bound_items(list, LEAST_EXPOSURES..=MAX_EXPOSURES, |label| {
                    label.enum_values = Some(Shutter::labels().map(Into::into).collect());
                })
            }
            ("exposure", RefOr::T(Schema::Object(label))) => label.enum_values = names(Shutter::labels().collect()),
            ("materials", RefOr::T(Schema::Object(count))) => {
                (count.minimum, count.maximum) = (Some(1.into()), Some(MAX_MATERIALS.into()));
            }
            ("model", RefOr::T(Schema::Object(name))) => name.enum_values = names(models()),
            ("lobe", RefOr::T(Schema::Object(name))) => name.enum_values = names(lobes()),
            ("gains", RefOr::T(Schema::Object(name))) => name.enum_values = names(GAINS.to_vec()),
            ("solver", RefOr::T(Schema::Object(name))) => name.enum_values = names(solvers()),
            ("objective", RefOr::T(Schema::Object(name))) => name.enum_values = names(objectives()),
            ("leave_out", RefOr::T(Schema::Array(list))) => bound_items(list, 0..=MAX_STATIONS, |light| {
                light.maximum = Some(MAX_STATIONS.into());
            }),
            _ => {}
        }
    }
}

/// The names a text may be; null stands for the rig file's.
fn names(known: Vec<&str>) -> Option<Vec<serde_json::Value>> {
    Some(known.into_iter().map(Into::into).chain([serde_json::Value::Null]).collect())
}

/// Bounds the number of items, forbids repeated ones, and lets `to_item` bound each.
fn bound_items(list: &mut Array, count: RangeInclusive<usize>, to_item: impl FnOnce(&mut Object)) {
    (list.min_items, list.max_items) = (Some(*count.start()), Some(*count.end()));
    list.unique_items = true;
    if let ArrayItems::RefOrSchema(items) = &mut list.items
        && let RefOr::T(Schema::Object(item)) = items.as_mut()
    {
        to_item(item);
    }
}

/// Adds a status the operation may refuse with, unless it names it itself.
fn refuse(operation: &mut Operation, (status, description): (&str, &str)) {
    let response = ResponseBuilder::new().description(description).build();
    operation.responses.responses.entry(status.into()).or_insert(RefOr::T(response));
}

fn complete(operation: &mut Operation) {
    for refusal in ANYWHERE {
        refuse(operation, *refusal);
    }
    for (status, response) in &mut operation.responses.responses {
        if let (true, RefOr::T(response)) = (status.as_str() >= "400", response) {
            let body = ContentBuilder::new().schema(Some(Ref::from_schema_name("Problem"))).build();
            response.content.insert("application/problem+json".into(), RefOr::T(body));
        }
    }
}

/// The document as it is sent, made once.
pub(super) fn text(spec: openapi::OpenApi, state: &HttpState) -> Bytes {
    // The document is made of text and numbers only: there is nothing in it that JSON could not say.
    serde_json::to_vec(&finish(spec, &state.rig, !state.tokens.is_empty())).unwrap_or_default().into()
}

/// The document as an answer.
pub(super) fn answer(text: Bytes) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], text).into_response()
}
